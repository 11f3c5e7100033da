"""From logs and a rig to normalised residuals: channels, restarts, state observer, angle alignment,
uncertainty of the input, blocks.
"""
