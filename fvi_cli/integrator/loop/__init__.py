"""The loop over the steps of a run: where they come from, what is kept of them."""
