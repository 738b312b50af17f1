"""Meshes: where steps begin and end, given beforehand or found on the way."""
