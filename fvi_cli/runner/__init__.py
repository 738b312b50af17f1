"""Which runs a request asks for: planned, computed or recalled, and kept."""
