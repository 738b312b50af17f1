"""Damping forces, works and energies along finished runs."""
