"""The runs of a request: planned, computed or read back, and stored."""
