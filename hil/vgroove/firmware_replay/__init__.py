"""Replay of a log through the native firmware: whether the duty follows from the measured inputs,
and which kind of firmware gap explains where it does not (docs/gap.md).
"""
