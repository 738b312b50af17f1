"""Floor 3: methods, and the one function in which scene and method meet."""
