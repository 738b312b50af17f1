"""Hard cases: claims where integrators usually fail, measured for every method."""
