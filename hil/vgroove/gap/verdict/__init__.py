"""From the search to the verdict: decision, calibrated probability, location of the gap, correlates."""
