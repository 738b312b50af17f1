"""Files of what is computed in the plane of complex frequencies."""
