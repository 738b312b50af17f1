"""Which steps of a method are stable, known before the run."""
