"""Linear scenes in the plane of complex frequencies: modes, and responses to harmonic forces."""
