"""The Hall edges behind a logged speed column: times, hidden and missed edges, scale, jitter."""
