"""The firmware that a board is assumed to run: mode and EEPROM parameters, from a JSON file."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path

from vgroove.eeprom_image import eeprom_image, mode_number, parameter
from vgroove.errors import VgrooveError

KEYS = ("mode", "params")


@dataclass(frozen=True)
class AssumedFirmware:
    """Mode by its name, and the EEPROM parameters that differ from their defaults, by name and in
    their physical units.
    """

    mode: str = "duty"
    params: Mapping[str, float] = field(default_factory=dict)

    def image(self) -> bytes:
        """The EEPROM; VgrooveError for an unknown mode or name, or a value out of range."""
        return eeprom_image({**self.params, "mode": mode_number(self.mode)})

    def raw(self, name: str) -> int:
        """Stored integer of a parameter."""
        entry = parameter(name)
        value = self.params.get(entry.name)
        return entry.default if value is None else round(value * 2**entry.q)

    def with_raw(self, name: str, raw: int) -> "AssumedFirmware":
        """The assumed firmware with another stored integer of a parameter."""
        return replace(self, params={**self.params, name: raw / 2 ** parameter(name).q})


def read_assumed_firmware(path: Path) -> AssumedFirmware:
    """The assumed firmware in a JSON file {"mode": NAME, "params": {NAME: VALUE}}; VgrooveError for
    another content.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise VgrooveError(f"{path}: no JSON file: {error}.") from None
    if not isinstance(content, dict):
        raise VgrooveError(f"{path}: it holds no object with the keys {' and '.join(KEYS)}.")
    for name in content:
        if name not in KEYS:
            raise VgrooveError(f"{path}: unknown key {name}; the keys are {' and '.join(KEYS)}.")
    mode, params = content.get("mode", "duty"), content.get("params", {})
    if not isinstance(mode, str) or not isinstance(params, dict):
        raise VgrooveError(f"{path}: mode is a name, and params an object of numbers by name.")
    return _checked(path, mode, params)


def _checked(path: Path, mode: str, params: Mapping[str, object]) -> AssumedFirmware:
    for name, value in params.items():
        is_number = isinstance(value, Real) and not isinstance(value, bool)
        if not is_number or not math.isfinite(value):
            raise VgrooveError(f"{path}: the parameter {name} is no number.")
    try:
        assumed = AssumedFirmware(
            mode, {parameter(name).name: value for name, value in params.items()}
        )
        assumed.image()
    except VgrooveError as error:
        raise VgrooveError(f"{path}: {error}.") from None
    return assumed
