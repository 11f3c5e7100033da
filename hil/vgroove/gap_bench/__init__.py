"""The blind set of the diagnosis: runs `vgroove gap diagnose` on sealed cases of the independent
generator and scores the verdicts.
"""
