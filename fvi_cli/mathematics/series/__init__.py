"""Chebyshev series."""
