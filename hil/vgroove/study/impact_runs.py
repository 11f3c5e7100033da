"""Runs of the impact tool for the studies, and the statistics of their blows."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError, refused_by_plant
from vgroove.reference.blows import BLOW, clean, hits_between
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.reference.rigs import with_load
from vgroove.rig import Rig
from vgroove.units import RPM_PER_RAD_S

LEAST_BLOWS = 3  # of a run from which a cycle is taken: the first is seldom a steady one


def with_joint(rig: Rig, joint: str, values: Mapping[str, float] | None = None) -> Rig:
    """The same tool on one of REFERENCE_JOINTS, and other values of dotted keys, if given."""
    return with_load(rig, REFERENCE_JOINTS[joint].load, values)


def simulate(rigs: Sequence[Rig], duration_s: float, duty: float, **options: Any) -> dict[str, Any]:
    """Simulate tools of one load kind from rest at a constant duty, with reference accuracy.

    Returns the columns of vgroove._core.simulate_impact, (tools, rows) each, and their time_s. Of
    the options, `row_s` is the interval of the rows (1 ms); the others are those of
    simulate_impact. Raises VgrooveError where the plant refuses the parameters.
    """
    row_s = options.pop("row_s", 1e-3)
    time_s = np.linspace(0.0, duration_s, round(duration_s / row_s) + 1)
    drive = _core.LogInput(
        time_s, "duty", np.full(len(time_s), duty), load_kind=rigs[0].load["kind"]
    )
    with refused_by_plant(rigs[0].name or "the rig"):
        rows = _core.simulate_impact(
            drive,
            np.array([rig.parameters() for rig in rigs]),
            **{"mode": "reference", "threads": 2, **options},
        )
    return {"time_s": time_s, **rows}


def last_cycle(
    rig: Rig, blows: np.ndarray, from_s: float, to_s: float, duty: float
) -> tuple[float, float]:
    """Start and end in s of the last whole cycle between two times of a run, from blow to blow, of
    the run's blows (structured array of simulate_impact). VgrooveError where there is none.
    """
    hits = hits_between(blows, from_s, to_s)
    first = hits["time_s"][hits["kind"] == BLOW]
    if len(first) < LEAST_BLOWS:
        raise VgrooveError(
            f"{rig.name or 'the rig'}: fewer than three blows from {from_s:g} to {to_s:g} s at "
            f"duty {duty:g} on load {rig.load['kind']}: there is no cycle to show"
        )
    return float(first[-2]), float(first[-1])


def blow_figures(
    rows: Mapping[str, Any], index: int, start_s: float, lug_height_m: float
) -> dict[str, float | int | None]:
    """Rate, current, torque and synchronism of run `index` of `rows`, from start_s to its end.

    A figure that needs two blows is None where there are fewer.
    """
    time_s = rows["time_s"]
    end_s, late = float(time_s[-1]), time_s > start_s
    hits = hits_between(rows["blows"][index], start_s, end_s)
    first = hits[hits["kind"] == BLOW]
    period = np.diff(first["time_s"])
    head = rows["head_rad"][index][late]
    figures: dict[str, float | int | None] = {
        "hits": len(hits),
        "current_a": float(rows["current_a"][index][late].mean()),
        "speed_rpm": float(rows["speed_rad_s"][index][late].mean() * RPM_PER_RAD_S),
        "hammer_max_mm": float(rows["hammer_mm"][index][late].max()),
        "blows_per_min": None,
        "period_spread_percent": None,
        "torque_peak_nm": None,
        "engaged_percent": None,
        "synchronism": None,
        "angle_per_blow_deg": None,
    }
    if len(period):
        figures |= {
            "blows_per_min": float(60.0 / period.mean()),
            "period_spread_percent": float(100 * period.std() / period.mean()),
            "torque_peak_nm": float(first["peak_torque_nm"].mean()),
            "engaged_percent": float(100 * first["engaged_m"].mean() / lug_height_m),
            "synchronism": float(clean(hits, lug_height_m).mean()),
            "angle_per_blow_deg": float(np.degrees(head[-1] - head[0]) / len(first)),
        }
    return figures
