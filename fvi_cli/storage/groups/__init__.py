"""Groups of a result file: a run, or the members of a sweep in common arrays."""
