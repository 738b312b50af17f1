"""Fits that are asked for, and what they leave behind."""
