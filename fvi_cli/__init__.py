"""Fractional variational integrators for mechanical systems with fractional damping."""

__version__ = "0.1.0"
