"""Share of a diagnosis that is done when a stage begins, and as it goes on, for progress bars."""

from collections.abc import Callable

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
REPEAT_STEP = 0.045  # part of the way to the next stage that each batch of simulations takes


class RepeatedProgress:
    """A progress callback. repeat() passes the text of the present stage on once more, whereupon a
    progress bar moves within that stage (StageShare).
    """

    def __init__(self, progress: Callable[[str], None]) -> None:
        self._progress, self._text = progress, ""

    def __call__(self, text: str) -> None:
        """A stage begins."""
        self._text = text
        self._progress(text)

    def repeat(self) -> None:
        """The stage goes on."""
        if self._text:
            self._progress(self._text)


class StageShare:
    """The share at each stage, 0 to 1; it never decreases. A stage that is repeated goes on towards
    the share of the next one.
    """

    def __init__(self) -> None:
        self._share, self._stage, self._next, self._grows = 0.0, "", 0.0, False

    def at(self, stage: str) -> float:
        """Share of the work before a stage with this text, or within it where it is repeated."""
        if stage == self._stage:
            self._share += REPEAT_STEP * max(0.0, self._next - self._share)
            return self._share
        self._stage = stage
        begins = next((share for text, share in SHARES.items() if stage.startswith(text)), 0.0)
        self._next = next((share for share in sorted(SHARES.values()) if share > begins), 1.0)
        if stage.startswith("a further effect"):
            if self._grows:
                begins = self._share + GROWTH_STEP * max(0.0, NEXT_STAGE_SHARE - self._share)
            self._next = begins + GROWTH_STEP * max(0.0, NEXT_STAGE_SHARE - begins)
            self._grows = True
        self._share = max(self._share, begins)
        return self._share
