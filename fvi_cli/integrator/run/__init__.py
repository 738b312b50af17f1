"""A run: where its steps come from, the loop over them, what is kept, and what is reported."""
