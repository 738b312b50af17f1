"""``fit``: what is read of measurements and parameters, and what is written of a fit."""
