"""What damping remembers of the past."""
