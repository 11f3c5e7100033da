"""Bench, recorder and sim-to-real gap diagnosis of the vgroove impact driver."""
