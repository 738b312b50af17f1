"""Damping of scenes, by the matrices along which it acts."""
