"""Blocks of equal steps of backward differences, and their past."""
