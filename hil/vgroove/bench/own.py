"""The plant as the comparisons run it: impact runs of several tools, and runs of the drivetrain."""

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from vgroove import _core
from vgroove.bench.impact_tool import RIG_KEYS, ImpactTool
from vgroove.reference.rigs import DRIVE_ALONE, reference_rig
from vgroove.units import TURN_RAD

Floats = npt.NDArray[np.float64]
ROW_S = 1e-3


def parameters(values: dict[str, float]) -> Floats:
    """(P,) in the order of _core.PARAMETERS; parameters without a value have their defaults."""
    theta = np.array(_core.parameter_defaults())
    for name, value in values.items():
        theta[_core.PARAMETERS.index(name)] = value
    return theta


def drive_values() -> dict[str, float]:
    """Supply, motor and gearbox of the reference drive by dotted key."""
    rig = reference_rig(DRIVE_ALONE)
    sections = {"supply": rig.supply, "motor": rig.motor, "gearbox": rig.gearbox}
    return {
        f"{section}.{key}": value
        for section, values in sections.items()
        for key, value in values.items()
    }


def impact_parameters(tool: ImpactTool) -> Floats:
    """(P,) of a tool of the comparison."""
    values = {key: getattr(tool, name) for name, key in RIG_KEYS.items()}
    radius = reference_rig().mechanism["groove_radius_m"]
    lugs = round(TURN_RAD / tool.pitch_rad)
    return parameters(values | {"mechanism.lug_count": lugs, "mechanism.groove_radius_m": radius})


def impact_log(duty: float, rows: int) -> _core.LogInput:
    """Constant duty from rest over rows of 1 ms, on a joint that slips."""
    time_s = np.arange(rows + 1) * ROW_S
    return _core.LogInput(time_s, "duty", np.full(rows + 1, duty), load_kind="hard_joint")


def impact_heads(
    tools: Sequence[ImpactTool], rows: int, mode: str, threads: int = 1
) -> Callable[[], Floats]:
    """A call that runs tools (B,) with one duty for `rows` ms and returns their head angles
    (B,).
    """
    log = impact_log(tools[0].duty, rows)
    theta = np.stack([impact_parameters(tool) for tool in tools])
    return lambda: _core.simulate_impact(log, theta, mode=mode, threads=threads)["head_rad"][:, -1]
