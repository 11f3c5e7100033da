"""The catalogue of effects: everything that needs a list of effects asks here."""
