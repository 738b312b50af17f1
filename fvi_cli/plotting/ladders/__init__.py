"""Figures of errors against step size or cost: curves, floors, slopes."""
