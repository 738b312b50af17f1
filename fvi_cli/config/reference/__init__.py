"""What is told of the keys: schema for editors, page to read, file to begin with."""
