"""The keys of an experiment beside its problem, a file for each that has rules of its own."""
