"""What a run will take and what order to expect, before it begins."""
