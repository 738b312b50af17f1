"""Floor 6: files, tables and figures."""
