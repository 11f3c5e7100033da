"""Which set of effects predicts held-out rows best: stepwise selection, model comparison and
confidence intervals.
"""
