"""What is stored of a run, whatever it lies in."""
