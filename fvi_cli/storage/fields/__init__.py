"""What a run has beside its trajectory, as datasets and attributes, and back."""
