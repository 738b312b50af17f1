"""Works, energies and momentum maps along a discrete motion."""
