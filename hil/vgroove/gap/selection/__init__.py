"""Which set of effects predicts held-out rows best: single effects, steps, model comparison, intervals."""
