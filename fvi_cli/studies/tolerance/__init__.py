"""Runs whose error keeps a tolerance at all times, or that state why it does not."""
