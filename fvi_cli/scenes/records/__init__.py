"""Reading files of samples, with complaints, and storing their contents as text."""
