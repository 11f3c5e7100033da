"""Makes the arrays of a frozen dataclass read-only, so that a measured problem cannot change."""

from typing import Any

import numpy as np


def freeze_arrays(data: Any) -> None:
    """Set every array among the fields of a dataclass read-only; call it from __post_init__."""
    for value in vars(data).values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
