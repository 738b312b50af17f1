"""What a solved step errs by: its spectrum, what lies between its stages, kinks, hidden walls."""
