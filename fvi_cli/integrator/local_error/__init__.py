"""Local error of a solved step: its spectrum, forces between stages, kinks, hidden walls."""
