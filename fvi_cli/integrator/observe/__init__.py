"""Requested outputs of a motion besides its positions: times, quantities, events, impacts."""
