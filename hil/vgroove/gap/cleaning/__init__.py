"""Cleaning of a log before the diagnosis: clock, lost rows, dead samples, gaps, command noise."""
