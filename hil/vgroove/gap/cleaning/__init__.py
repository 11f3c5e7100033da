"""Cleaning of a log before it is judged: clock, lost rows, dead samples, missing values, command noise."""
