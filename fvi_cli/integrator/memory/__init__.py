"""The memory of dampers: sums of exponentials, backward differences, and the force of the past."""
