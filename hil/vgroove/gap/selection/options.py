"""What a caller of the diagnosis chooses."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class DiagnosisOptions:
    """Options of a diagnosis.

    seed: of the bootstrap; without: ids of effects that are excluded from the catalogue; progress:
    receives a text at each stage.
    """

    seed: int = 0
    without: Sequence[str] = ()
    progress: Callable[[str], None] = lambda _: None
