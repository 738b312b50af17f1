"""How a run depends on the numbers of its scene: tangents forwards, the adjoint backwards."""
