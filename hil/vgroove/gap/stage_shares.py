"""Share of a diagnosis that is done when a stage begins, for progress bars."""

# Text with which a stage begins -> share of the wall time before it, as measured on the cases of
# tests/data/practice, rounded; a search grows by as many steps as the log needs.
SHARES = {
    "reading": 0.0,
    "fitting": 0.09,
    "the torque balance": 0.1,
    "each effect": 0.12,
    "a further effect": 0.55,
    "whether every effect": 0.86,
    "rivals": 0.87,
    "what remains": 0.93,
}
NEXT_STAGE_SHARE = 0.86  # towards which the steps of growth approach
GROWTH_STEP = 0.5  # part of the way to it that each step takes


class StageShare:
    """The share at each stage, 0 to 1; it never decreases."""

    def __init__(self) -> None:
        self._share, self._grows = 0.0, False

    def at(self, stage: str) -> float:
        """Share of the work before a stage with this text."""
        begins = next((share for text, share in SHARES.items() if stage.startswith(text)), 0.0)
        if stage.startswith("a further effect"):
            if self._grows:
                begins = self._share + GROWTH_STEP * max(0.0, NEXT_STAGE_SHARE - self._share)
            self._grows = True
        self._share = max(self._share, begins)
        return self._share
