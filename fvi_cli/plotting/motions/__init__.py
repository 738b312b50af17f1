"""Figures of motions: over time, in the plane, at events, over the period."""
