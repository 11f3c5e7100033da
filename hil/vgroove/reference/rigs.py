"""The rigs under rigs/ by name: the only source of the reference tools' values."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from vgroove.errors import VgrooveError
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.rig import Rig, read_rig, rig_from_dict

IMPACT_DRIVER = "impact_driver"  # docs/spec/model.md, section 4: the reference set of 18 V class
LOW_GEAR = "drill_driver_low"  # docs/spec/model.md, section 7
# the same motor and gear without the impact mechanism, with all inertia behind the gear
DRIVE_ALONE = "impact_driver_18v"
_PACKAGE = Path(__file__).resolve().parents[1]
# of a checkout; of an installed package
_FOLDERS = (_PACKAGE.parents[1] / "rigs", _PACKAGE / "rigs")


def reference_rig(name: str = IMPACT_DRIVER) -> Rig:
    """The rig of rigs/NAME.toml; VgrooveError where there is no such file."""
    paths = [folder / f"{name}.toml" for folder in _FOLDERS]
    for path in paths:
        if path.exists():
            return read_rig(path)
    raise VgrooveError(f"{paths[0]}: the reference rig {name} is missing")


def impact_rig(path: Path | None) -> Rig:
    """The impact tool of a file, or the reference tool on a locked joint where `path` is None.

    Raises VgrooveError where the rig has no impact mechanism or is not driven by a duty.
    """
    if path is None:
        return with_load(reference_rig(), REFERENCE_JOINTS["locked"].load)
    rig = read_rig(path)
    if rig.mechanism["kind"] != "impact":
        raise VgrooveError(f'{path}: this study needs [mechanism] kind = "impact"')
    if rig.input["kind"] != "duty" or "voltage_v" not in rig.supply:
        raise VgrooveError(
            f"{path}: this study drives the tool by a duty: [input] kind and [supply] voltage_v"
        )
    return rig


def with_load(rig: Rig, load: Mapping[str, Any], values: Mapping[str, float] | None = None) -> Rig:
    """The same tool with another section [load], and other values of dotted keys, if given."""
    return rig_from_dict(
        {**rig.as_dict(), "load": dict(load)}, "the rig on another joint"
    ).with_values(values or {})
