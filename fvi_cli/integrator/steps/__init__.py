"""One step of the integrator: its equations, and what solves them."""
