"""A configuration in parts: who computes what, and how the files of the parts are joined."""
