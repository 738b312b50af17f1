"""``fit``: reading of measurements and parameters, and writing of fitted configurations."""
