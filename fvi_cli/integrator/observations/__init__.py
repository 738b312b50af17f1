"""What is asked of a motion beside its positions: times, quantities, events, impacts."""
