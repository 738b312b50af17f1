"""Methods that users would write otherwise, for comparison."""
