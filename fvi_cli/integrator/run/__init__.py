"""A run: what is prepared, the loop over steps, and what comes of it."""
