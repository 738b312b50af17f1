"""The engine: one loop, one Newton's iteration and one memory for scenes of every kind."""
