"""Motions that bounce off surfaces: steps that end on them, and changes of the momentum."""
