"""Structures of finite-element programs: matrices from files."""
