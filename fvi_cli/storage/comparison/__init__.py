"""Differences between stored runs and requested ones."""
