"""Figures of what is asked of a motion: quantities over time, and sections at events."""
