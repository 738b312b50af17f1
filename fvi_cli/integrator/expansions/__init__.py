"""Powers of time with which a motion begins, and what they cost."""
