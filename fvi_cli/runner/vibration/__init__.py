"""Modes and harmonic responses that a request asks for."""
