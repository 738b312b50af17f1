"""Structures as finite-element programs have them: matrices from files."""
