"""The options of a diagnosis."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from numbers import Integral
from typing import TYPE_CHECKING

from vgroove.errors import VgrooveError

if TYPE_CHECKING:
    from vgroove.log import ColumnMap
    from vgroove.rig import Rig


@dataclass(frozen=True)
class DiagnosisOptions:
    """seed: of the bootstrap; without: ids of effects that are excluded from the catalogue;
    progress: is called with a text at each stage; from_s, to_s: range in s of each log's own time
    column outside of which no row is used (None: no bound); as_is: use logs whose units, signs or
    time base look wrong; columns: which column of a file or table is which column of a log
    (vgroove.log.column_map; None: those of the same name); joints: of a hammering tool, for each
    log the rig with that log's own joint (empty: all logs have the rig's). VgrooveError for a seed
    that is no whole number of 0 or more.
    """

    seed: int = 0
    without: Sequence[str] = ()
    progress: Callable[[str], None] = lambda _: None
    from_s: float | None = None
    to_s: float | None = None
    as_is: bool = False
    columns: "ColumnMap | None" = None
    joints: Sequence["Rig"] = ()

    def __post_init__(self) -> None:
        number = isinstance(self.seed, Integral) and not isinstance(self.seed, bool)
        if not number or self.seed < 0:
            raise VgrooveError(f"seed must be a whole number of 0 or more, not {self.seed!r}")
