"""From YAML text, and changes of it, to a tree of nodes."""
