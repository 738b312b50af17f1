"""Records of runs, independent of the file in which they are stored."""
