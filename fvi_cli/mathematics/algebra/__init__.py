"""Arithmetic of formulas, and straight-line programs of them."""
