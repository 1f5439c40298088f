"""Reports: one self-contained HTML file each, from finished results. Nothing is computed here."""
