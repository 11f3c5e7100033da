"""The Hall edges behind a logged speed column: their times, hidden and missed edges, scale and jitter."""
