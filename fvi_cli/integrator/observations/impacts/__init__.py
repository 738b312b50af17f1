"""Motions that bounce off surfaces: steps that end on these, and what they do to the momentum."""
