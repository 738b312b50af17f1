"""Measurements of a fit and its models, and the configuration with fitted numbers."""
