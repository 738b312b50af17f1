"""In what stored runs differ from those that are asked for."""
