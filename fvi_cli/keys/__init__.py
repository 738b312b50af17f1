"""Floor 2: what may stand under a key, declared once: read, checked, and described for editors."""
