"""Reference values and routes written apart from the package."""
