"""Figures of modes and of harmonic responses."""
