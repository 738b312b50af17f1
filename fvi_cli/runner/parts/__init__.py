"""Division of a configuration into parts for several commands, and merging of their files."""
