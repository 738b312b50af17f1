"""Methods that take equal steps: backward differences, one step after the other."""
