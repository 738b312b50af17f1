"""Kinds of structures: by their matrices, and by finite elements."""
