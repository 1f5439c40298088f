"""From the table of an unknown force to laws that one can add."""
