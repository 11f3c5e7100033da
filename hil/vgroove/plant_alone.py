"""`vgroove sim SCENARIO`: the plant alone with the trigger's travel as duty, without firmware. The
log has the effects of the rig's sensors except missed edges, and neither noise nor steps of a
converter.
"""

from typing import Any

import numpy as np
from rich.table import Table

from vgroove.errors import VgrooveError, refused_by_plant
from vgroove.lockstep import Profile, interpolate_points, step_values
from vgroove.log import Log
from vgroove.reference.blows import BLOW, REPEAT
from vgroove.rig import Rig
from vgroove.scenario import Scenario
from vgroove.units import RPM_PER_RAD_S

SCHEMA = "vgroove.sim_scenario/1"
ROW_S = 1e-3
DRILL_STEP_S = ROW_S / 32  # of the drill driver: close to a PWM period
CHUCK_CHANNELS = ("chuck_rpm", "shaft_nm", "chuck_load_nm")
TEST_BENCH_CHANNELS = (
    "anvil_torque_nm",
    "anvil_angle_rad",
    "hammer_mm",
    "head_rad",
    "housing_nm",
    "arm_rad",
)


def profile_columns(profile: Profile, time_s: np.ndarray) -> dict[str, np.ndarray]:
    """`duty` (travel, negative in reverse), `coast` (contact open) and `load_nm` of a profile;
    a value holds over the row (1 ms) that ends at its time.
    """
    starts = np.maximum(time_s - ROW_S, 0.0)
    travel = interpolate_points(profile.travel, starts)
    pressed = travel >= profile.contact_travel
    sign = np.where(step_values(profile.reverse, starts) > 0.5, -1.0, 1.0)
    return {
        "duty": np.where(pressed, sign * travel, 0.0),
        "coast": np.where(pressed, 0.0, 1.0),
        "load_nm": interpolate_points(profile.load_nm, time_s),
    }


def simulate_scenario(scenario: Scenario) -> Log:
    """Rows of 1 ms, the first at rest: current (A) and bus (V) as means of the row, speed (rpm) and
    angle (rad) of the shaft at its end, each with the effects of its sensor.

    An impact tool also has the channels of a test bench (torque of the joint, angle of anvil and
    head, hammer, housing, arm), and figures of its blows in `meta`. A drill driver has speed and
    load of the chuck and the shaft's torque, and its pulse mode where the rig has `pulse = true`.
    """
    from vgroove import _core

    tool = scenario.tool
    if tool.input["kind"] != "duty":
        raise VgrooveError(
            f"{scenario.source}: a trigger drives the bridge: the rig's [input] kind must be duty, "
            f"not {tool.input['kind']}"
        )
    time_s = ROW_S * np.arange(round(scenario.duration_s / ROW_S) + 1)
    columns = profile_columns(scenario.profile, time_s)
    if tool.mechanism["kind"] == "drill_driver":
        return _simulate_drill(scenario, time_s, columns)
    drive = _core.LogInput(
        time_s,
        "duty",
        columns["duty"],
        slew_per_s=tool.input.get("slew_per_s"),
        load_nm=columns["load_nm"],
        coast=columns["coast"],
        load_kind=tool.load.get("kind", "none"),
    )
    meta = {}
    with refused_by_plant(scenario.source):
        if tool.mechanism["kind"] == "impact":
            rows = _core.simulate_impact(drive, tool.parameters()[None, :], mode="fast")
            columns |= {name: rows[name][0] for name in TEST_BENCH_CHANNELS}
            meta = impact_figures(
                rows["blows"][0],
                full_duty_stretches(rows["blows"][0]["time_s"], time_s, columns["duty"]),
                float(rows["head_rad"][0, -1]),
            )
        else:
            rows = _core.simulate_log(
                drive, tool.parameters()[None, :], np.array([0]), np.zeros((1, 3)), threads=1
            )
    columns |= {name: rows[name][0] for name in ("supply_v", "current_a")}
    columns |= {
        "speed_rpm": rows["speed_measured_rad_s"][0] * RPM_PER_RAD_S,
        "position_rad": rows["angle_measured_rad"][0],
    }
    return Log(time_s, columns, scenario.source, meta=meta)


def row_start_duty(duty: np.ndarray, slew_per_s: float | None) -> np.ndarray:
    """Duty (n,) at the start of each row, from which it changes linearly to the row's own: the duty
    of the row before, or the row's own (a step) where the change exceeds the slew rate.
    """
    before = np.concatenate([duty[:1], duty[:-1]])
    return np.where(
        np.abs(duty - before) <= (slew_per_s or 0.0) * ROW_S * (1.0 + 1e-9), before, duty
    )


def make_drill(tool: Rig) -> Any:
    """The drill driver of a rig for runs without a board: steps of DRILL_STEP_S."""
    from vgroove import _core

    return _core.DrillPlant(
        tool.drill_parameters(),
        tool.value("supply.resistance_ohm"),
        hall_pulses_per_rev=0,
        step_s=DRILL_STEP_S,
    )


def _simulate_drill(scenario: Scenario, time_s: np.ndarray, columns: dict[str, np.ndarray]) -> Log:
    begins = row_start_duty(columns["duty"], scenario.tool.input.get("slew_per_s"))
    with refused_by_plant(scenario.source):
        plant = make_drill(scenario.tool)
        commands = (
            column[1:].tolist()
            for column in (columns["duty"], columns["coast"] != 0.0, columns["load_nm"], begins)
        )
        rows = [plant.advance(ROW_S, *command) for command in zip(*commands, strict=True)]

    def column(name: str, first: float = 0.0) -> np.ndarray:
        return np.array([first, *(getattr(row, name) for row in rows)])

    columns |= {
        "supply_v": column("supply_v", scenario.tool.supply["voltage_v"]),
        "current_a": column("current_a"),
        "speed_rpm": column("speed_rad_s") * RPM_PER_RAD_S,
        "position_rad": column("angle_rad"),
    }
    columns |= dict(
        zip(
            CHUCK_CHANNELS,
            (column("chuck_rad_s") * RPM_PER_RAD_S, column("shaft_nm"), column("load_nm")),
            strict=True,
        )
    )
    meta = {
        "chuck_peak_rpm": float(np.max(np.abs(columns["chuck_rpm"]))),
        "shaft_peak_nm": float(np.max(column("shaft_peak_nm"))),
        "clutch_slipped_s": float(np.sum(column("slipped_s"))),
    }
    return Log(time_s, columns, scenario.source, meta=meta)


def full_duty_stretches(at_s: np.ndarray, time_s: np.ndarray, duty: np.ndarray) -> np.ndarray:
    """Number (k,) of the stretch of rows, from 1, in which each of the times at_s (k,) lies and in
    which the duty (n,) keeps its largest magnitude; 0 at another duty.
    """
    full = np.abs(duty) >= np.max(np.abs(duty))
    begins = full & ~np.concatenate([[False], full[:-1]])
    row = np.minimum(np.searchsorted(time_s, at_s), len(duty) - 1)
    return np.where(full, np.cumsum(begins), 0)[row]


def impact_figures(
    blows: np.ndarray, stretch: np.ndarray, head_rad: float
) -> dict[str, float | int]:
    """Figures of the blows (k,) (structured array of simulate_impact) at full duty, whose stretches
    (k,) are given: the number of blows and of repeats; from the second half of the blows their
    rate, the spread of the period, the peak torque and the engaged height; the head's angle. A
    period is the time between blows of one stretch.
    """
    kinds = blows["kind"]
    first = np.flatnonzero((stretch > 0) & (kinds == BLOW))
    late = first[len(first) // 2 :]
    period = np.diff(blows["time_s"][late])[np.diff(stretch[late]) == 0]
    figures: dict[str, float | int] = {
        "blows": len(first),
        "repeats": int(np.sum((stretch > 0) & (kinds == REPEAT))),
        "head_end_rad": head_rad,
    }
    if len(period):
        figures |= {
            "blows_per_min": float(60.0 / period.mean()),
            "period_spread_percent": float(100.0 * period.std() / period.mean()),
            "torque_peak_nm": float(blows["peak_torque_nm"][late].max()),
            "engaged_mean_mm": float(1e3 * blows["engaged_m"][late].mean()),
        }
    return figures


def scenario_figures(log: Log) -> dict[str, float | int | str]:
    """Figures of a run of the plant, JSON-ready."""
    current, speed = log.columns["current_a"], log.columns["speed_rpm"]
    return {
        "schema": SCHEMA,
        "rows": len(log),
        "current_peak_a": float(np.max(np.abs(current))),
        "current_rms_a": float(np.sqrt(np.mean(current**2))),
        "speed_peak_rpm": float(speed[np.argmax(np.abs(speed))]),
        "speed_end_rpm": float(speed[-1]),
        "supply_least_v": float(np.min(log.columns["supply_v"])),
        "turns": float(log.columns["position_rad"][-1] / (2.0 * np.pi)),
        **log.meta,
    }


def scenario_table(figures: dict[str, float | int | str]) -> Table:
    """The figures as a table; the unit ends each name."""
    table = Table("figure", "value", title="the plant alone", title_justify="left")
    for name, value in figures.items():
        if name != "schema":
            table.add_row(name, f"{value:.5g}")
    return table
