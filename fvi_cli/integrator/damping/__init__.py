"""All that damps scenes, by the matrices along which it acts."""
