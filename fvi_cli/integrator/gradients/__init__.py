"""Derivatives of runs by the numbers of their scenes: tangents forwards, the adjoint backwards."""
