"""Relaxation laws: forces that remember the velocity with a completely monotone kernel."""
