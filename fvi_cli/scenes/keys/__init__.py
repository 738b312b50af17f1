"""Keys of configurations as pydantic models, and the words for what is wrong with values."""
