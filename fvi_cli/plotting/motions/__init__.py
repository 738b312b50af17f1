"""Figures of motions: over time, in space, at events, of one run or the members of a sweep."""
