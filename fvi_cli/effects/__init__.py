"""Floor 2: what acts on a mechanical system, as small frozen values."""
