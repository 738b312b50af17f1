"""Figures of motions: over time, in a plane, at events, and over the period."""
