"""Output of commands: texts, files, and comparison with files."""
