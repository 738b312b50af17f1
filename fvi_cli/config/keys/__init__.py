"""The keys of an experiment other than its problem; a file for each key with rules of its own."""
