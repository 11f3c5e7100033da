"""Log and model to normalised residuals: channels, restarts, state observer, angle alignment, blocks."""
