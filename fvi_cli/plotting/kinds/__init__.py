"""The kinds of figures: what each of them shows."""
