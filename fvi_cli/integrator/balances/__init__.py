"""Damping forces, works, energies and momentum maps along finished runs."""
