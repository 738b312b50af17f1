"""The fits of a request, and the files that they write."""
