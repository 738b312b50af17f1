"""Floor 2: shapes of values under keys: declared once, then read, checked and described."""
