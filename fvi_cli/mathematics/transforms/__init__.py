"""Zeros of characteristic functions and inverse Laplace transforms."""
