"""Makes logs (docs/spec/gap.md, section 1) from a known motion: what tests of the diagnosis compare
with.
"""

from dataclasses import dataclass, field

import numpy as np

from vgroove import _core
from vgroove.rig import Rig, rig_from_dict


@dataclass
class MadeLog:
    """Looks like vgroove.log.Log."""

    time_s: np.ndarray
    columns: dict[str, np.ndarray]
    source: str = "made"
    warnings: list[str] = field(default_factory=list)


RIG = {
    "schema": "vgroove.rig/1",
    "name": "impact driver, 18 V",
    "input": {"kind": "duty", "slew_per_s": 6.0},
    "supply": {"voltage_v": 18.0, "resistance_ohm": 0.0},
    "bridge": {"pwm_hz": 20000},
    "motor": {
        "resistance_ohm": 0.19,
        "inductance_h": 1e-4,
        "torque_constant_nm_per_a": 0.0109,
        "inertia_kg_m2": 1.6e-5,
        "viscous_nm_s_per_rad": 4.5e-6,
        "coulomb_nm": 0.012,
    },
    "gearbox": {"ratio": 5.6, "output_inertia_kg_m2": 6e-5},
    "mechanism": {"kind": "none"},
    "load": {"kind": "none"},
    "sensors": {
        "log_hz": 1000,
        "current_noise_a": 0.15,
        "current_lsb_a": 0.1,
        "speed_lsb_rpm": 0.5,
        "hall_pulses_per_rev": 4,
        "hall_timeout_s": 0.05,
        "supply_noise_v": 0.02,
    },
}


def rig(**sections: dict) -> Rig:
    """The rig above with some sections replaced or extended."""
    data = {**RIG, **{name: {**RIG.get(name, {}), **values} for name, values in sections.items()}}
    return rig_from_dict(data, "the test's rig")


def edge_times(
    time_s: np.ndarray, angle_rad: np.ndarray, pulses: int, phase: float = 0.3
) -> np.ndarray:
    """Times at which an angle that only grows passes the edges (phase + k) 2 pi / pulses."""
    turns = angle_rad * pulses / (2.0 * np.pi) - phase
    edges = np.arange(np.ceil(turns[0] + 1e-12), np.floor(turns[-1]) + 1)
    rising = np.concatenate([[True], np.diff(turns) > 1e-12])
    return np.interp(edges, turns[rising], time_s[rising])


def hall_column(
    time_s: np.ndarray, edges: np.ndarray, pulses: int, timeout_s: float, lsb_rpm: float
) -> np.ndarray:
    """Speed column (rpm) from edge times (docs/spec/gap.md, section 1)."""
    speed = np.zeros(len(time_s))
    last = np.searchsorted(edges, time_s, side="right") - 1
    for i, (now, k) in enumerate(zip(time_s, last, strict=True)):
        if k < 1 or now - edges[k] > timeout_s or edges[k] - edges[k - 1] > timeout_s:
            continue
        period = edges[k] - edges[k - 1]
        if pulses >= 16 and i and last[i - 1] >= 0 and k > last[i - 1]:
            period = (edges[k] - edges[last[i - 1]]) / (k - last[i - 1])
        speed[i] = 60.0 / pulses / max(period, now - edges[k])
    return np.round(speed / lsb_rpm) * lsb_rpm if lsb_rpm else speed


def profile(time_s: np.ndarray, levels: list[tuple[float, float]], slew_per_s: float) -> np.ndarray:
    """Command that runs at its slew rate to each level (from time, level) in turn."""
    duty, value = np.zeros(len(time_s)), 0.0
    for i in range(1, len(time_s)):
        goal = next((level for start, level in reversed(levels) if time_s[i] >= start), 0.0)
        step = slew_per_s * (time_s[i] - time_s[i - 1])
        value += float(np.clip(goal - value, -step, step))
        duty[i] = value
    return duty


LEVELS = [(0.3, 0.35), (1.0, 0.8), (1.8, 0.5), (2.6, 1.0), (3.4, 0.25), (4.2, 0.7), (5.2, 0.4)]


def held_run(tool: Rig, command: np.ndarray, row_s: float, fine: int) -> dict[str, np.ndarray]:
    """Angle, rad, and current, A, of a tool that starts at rest, every row_s / fine; each value of
    the command (rows,) acts from its row to the next.
    """
    driving = np.repeat(command, fine)[: (len(command) - 1) * fine + 1]
    fine_s = np.arange(len(driving)) * row_s / fine
    drive = _core.LogInput(fine_s, tool.input["kind"], np.append(driving[:1], driving[:-1]))
    start = np.array([0]), np.zeros((1, 3))
    found = _core.simulate_log(drive, tool.parameters()[None], *start)
    return {name: found[name][0] for name in ("angle_rad", "current_a")}


def drive_log(
    tool: Rig,
    seed: int = 1,
    seconds: float = 6.0,
    levels: list[tuple[float, float]] | None = None,
    noise: bool = True,
    dropout: float = 0.0,
    slew_per_s: float = 6.0,
) -> MadeLog:
    """A log of a tool that is exactly the plant with the rig's parameters; the sensors are those of
    the rig.
    """
    rng = np.random.default_rng(seed)
    fine = np.arange(0, round(seconds * 1e4) + 1) * 1e-4
    time_s = fine[::10]
    duty = profile(time_s, LEVELS if levels is None else levels, slew_per_s)
    kind = tool.input["kind"]
    command = duty if kind == "duty" else duty * 18.0
    slew = tool.input.get("slew_per_s")
    rows, smooth = (
        _core.simulate_log(
            _core.LogInput(t, kind, np.interp(t, time_s, command), slew_per_s=slew),
            tool.parameters()[None],
            np.array([0]),
            np.zeros((1, 3)),
        )
        for t in (time_s, fine)
    )
    s = tool.sensors
    edges = edge_times(
        fine, smooth["angle_measured_rad"][0], s["hall_pulses_per_rev"], rng.random()
    )
    edges = edges[rng.random(len(edges)) >= dropout] if dropout else edges
    scale = 1.0 if noise else 0.0
    current = rows["current_a"][0] + scale * s["current_noise_a"] * rng.standard_normal(len(time_s))
    supply = rows["supply_v"][0] + scale * s["supply_noise_v"] * rng.standard_normal(len(time_s))
    lsb = s["current_lsb_a"]
    return MadeLog(
        time_s,
        {
            kind: command,
            "current_a": np.round(current / lsb) * lsb,
            "supply_v": supply,
            "speed_rpm": hall_column(
                time_s, edges, s["hall_pulses_per_rev"], s["hall_timeout_s"], s["speed_lsb_rpm"]
            ),
        },
    )
