"""Kinds of problems: what stands under ``problem``."""
