"""Parameters from measurements: what is fitted, how, and how sure it is."""
