"""Floor 4: named problems, as functions that build a scene out of effects."""
