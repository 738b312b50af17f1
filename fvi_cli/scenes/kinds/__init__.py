"""Kinds of problems, each with its keys under ``problem``."""
