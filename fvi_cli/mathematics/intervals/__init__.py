"""Ranges of formulas: interval arithmetic on arrays."""
