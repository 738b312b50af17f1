"""Hard cases: what must hold where integrators usually fail, measured for every method."""
