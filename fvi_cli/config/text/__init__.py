"""From YAML text and its overrides to a tree of nodes."""
