"""Meshes: where steps begin and end, given beforehand or chosen during the run."""
