"""Forecasts before a run begins: its cost, memory, order of convergence and resolution."""
