"""Files of samples and matrices: read, complained of, and put into a text that travels."""
