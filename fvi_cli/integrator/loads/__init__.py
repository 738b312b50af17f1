"""Forces that are known in advance, as load vectors of single steps."""
