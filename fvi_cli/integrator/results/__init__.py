"""Values that a run gives: steps as polynomials, observations, diagnostics."""
