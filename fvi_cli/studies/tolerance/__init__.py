"""Runs whose error keeps a tolerance at all times, or that say why it does not."""
