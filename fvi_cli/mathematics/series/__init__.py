"""Power series with real exponents, and sums of powers."""
