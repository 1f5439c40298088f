# SPDX-License-Identifier: Apache-2.0
"""Reports: one self-contained HTML file each, from finished results. Nothing is computed here."""
