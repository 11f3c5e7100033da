"""From the search to the verdict: decision, calibrated probabilities, location of the gap, and what
the remainder depends on.
"""
