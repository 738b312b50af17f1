"""Floor 1: numbers and functions that know nothing of mechanics."""
