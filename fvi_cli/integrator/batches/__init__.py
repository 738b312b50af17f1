"""Scenes of one kind, integrated side by side on one mesh."""
