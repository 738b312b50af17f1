"""Fits of parameters to measurements: settings, search, and confidence intervals."""
