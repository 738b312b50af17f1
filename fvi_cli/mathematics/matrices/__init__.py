"""Functions of small matrices."""
