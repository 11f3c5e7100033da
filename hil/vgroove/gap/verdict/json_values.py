"""Dataclasses and NumPy numbers as the values of a JSON text."""

from collections.abc import Mapping
from dataclasses import Field, fields, is_dataclass
from typing import Any

import numpy as np

from vgroove.gap.verdict.schema import OMIT_IF_EMPTY

SIGNIFICANT_DIGITS = 10  # of numbers: the last bits differ between machines


def as_json(value: Any) -> Any:
    """The same in dicts, lists and Python numbers of SIGNIFICANT_DIGITS digits."""
    if is_dataclass(value):
        return {f.name: as_json(getattr(value, f.name)) for f in fields(value) if _is_set(value, f)}
    if isinstance(value, Mapping):
        return {str(k): as_json(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [as_json(v) for v in value]
    value = value.item() if isinstance(value, np.generic) else value
    return float(f"{value:.{SIGNIFICANT_DIGITS}g}") if isinstance(value, float) else value


def _is_set(value: Any, one: "Field[Any]") -> bool:
    """False for an empty field that the JSON leaves out."""
    return one.metadata != OMIT_IF_EMPTY or bool(getattr(value, one.name))
