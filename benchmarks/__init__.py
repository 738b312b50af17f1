"""What the engine takes, for those who work on it: ``python -m benchmarks``."""
