"""Comparisons with other software (peers), each in one run on one machine."""
