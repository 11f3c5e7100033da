"""Setpoints of the controllers and the torque map for a tool of its own (`vgroove adapt`)."""
