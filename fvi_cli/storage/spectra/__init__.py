"""Files of results in the plane of complex frequencies."""
