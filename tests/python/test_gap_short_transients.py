"""Logs like those of simple loggers: a motor without inductance that is simulated here, not by the
plant, its speed measured late, in a log of few rows or of long row intervals.
"""

import numpy as np
import pytest

from made_log import MadeLog
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.selection.model_comparison import autocorrelation, stationary_variance
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.search_state import Search
from vgroove.gap.selection.single_effects import fit_single_effects
from vgroove.gap.stages import begin_search, load
from vgroove.gap.verdict.consistency import is_significant_size
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RAD_S_PER_RPM

SUPPLY_V, STEPS = 12.0, 20  # steps of the simulation in a row


def motor_rig(
    full_rad_s: float, time_constant_s: float, resistance_ohm: float = 6.0, henry: float = 1e-4
) -> Rig:
    """A motor that reaches full_rad_s at duty 1 with a time constant; the duty of a row holds after
    it.
    """
    constant = SUPPLY_V / full_rad_s
    return rig_from_dict(
        {
            "schema": "vgroove.rig/1",
            "input": {"kind": "duty", "hold": "after"},
            "supply": {"voltage_v": SUPPLY_V},
            "motor": {
                "resistance_ohm": resistance_ohm,
                "inductance_h": henry,
                "torque_constant_nm_per_a": constant,
                "inertia_kg_m2": time_constant_s * constant**2 / resistance_ohm,
                "viscous_nm_s_per_rad": 0.0,
                "coulomb_nm": 0.0,
            },
            "gearbox": {"ratio": 1.0, "output_inertia_kg_m2": 0.0},
            "mechanism": {"kind": "none"},
            "load": {"kind": "none"},
        },
        "a motor",
    )


def late_log(
    tool: Rig,
    time_s: np.ndarray,
    duty: np.ndarray,
    late_s: dict[str, float],
    noise_rad_s: float,
    added_rad_s: float = 0.0,
) -> MadeLog:
    """A log of the motor whose speed passes a delay (`delay`) and a first-order filter (`lag`).
    added_rad_s: to the steady speed in both directions.
    """
    motor, step_s = tool.motor, (time_s[1] - time_s[0]) / STEPS
    full = SUPPLY_V / motor["torque_constant_nm_per_a"]
    tau = motor["inertia_kg_m2"] * motor["resistance_ohm"] * (full / SUPPLY_V) ** 2
    speed = filtered(full * np.repeat(duty, STEPS) + added_rad_s, tau, step_s)
    shift = round(late_s.get("delay", 0.0) / step_s)
    speed = np.concatenate([np.full(shift, speed[0]), speed])[: len(speed)]
    if "lag" in late_s:
        speed = filtered(speed, late_s["lag"], step_s)
    noise = noise_rad_s * np.random.default_rng(3).standard_normal(len(time_s))
    return MadeLog(time_s, {"duty": duty, "speed_rpm": (speed[::STEPS] + noise) / RAD_S_PER_RPM})


def filtered(value: np.ndarray, time_constant_s: float, step_s: float) -> np.ndarray:
    """Output of a first-order filter at the start of each step, from rest in its first input."""
    out, state = np.zeros(len(value)), value[0]
    share = 1.0 - np.exp(-step_s / time_constant_s)
    for k, goal in enumerate(value):
        out[k] = state
        state += share * (goal - state)
    return out


def search_of_lag(log: MadeLog, tool: Rig) -> Search:
    """A search in which the lag of the speed sensor alone is fitted."""
    options = DiagnosisOptions(without=tuple(i for i in BY_ID if i != "speed_lag"))
    return fit_single_effects(begin_search(load([log], tool, options), options))


@pytest.mark.parametrize("delay_s", [0.1, 0.15])
def test_a_delay_of_several_rows_of_a_slow_logger_is_found_with_its_size(delay_s: float) -> None:
    """The measured state at a restart hides a delay that is as long as the interval between
    restarts.
    """
    tool, time_s = motor_rig(30.0, 0.4), 0.025 * np.arange(500)
    duty = 0.5 + 0.3 * np.sin(2.0 * np.pi * time_s / 1.3)
    log = late_log(tool, time_s, duty, {"delay": delay_s}, 0.1)
    search = search_of_lag(log, tool)
    one = search.fits[("speed_lag",)]
    theta = one.theta(search.problem.theta0)
    found_s = theta[search.problem.index("effects.speed_lag.time_constant_s")]
    assert found_s == pytest.approx(delay_s, rel=0.05)


def test_a_lag_that_shows_in_one_reversal_is_significant() -> None:
    """It shows in ten rows of 81, in fewer blocks than a jackknife needs; the steady speeds differ
    from the rig's besides.
    """
    tool, time_s = motor_rig(68.0, 0.0426), 0.01 * np.arange(81)
    duty = np.where(time_s < 0.255, 0.73, -0.745)
    search = search_of_lag(late_log(tool, time_s, duty, {"lag": 0.0155}, 0.15, 0.8), tool)
    assert is_significant_size(search, search.fits[("speed_lag",)], "speed_lag")


@pytest.mark.parametrize("rows", [1, 8, 50])
def test_residuals_of_zero_have_the_variance_of_unit_noise(rows: int) -> None:
    """A set that follows a column exactly leaves them."""
    weight = np.random.default_rng(1).standard_normal(rows)
    assert autocorrelation(np.zeros(rows), 10).tolist() == [0.0]
    variance, freedom = stationary_variance(weight, np.zeros(rows))
    assert variance == pytest.approx(weight @ weight) and freedom == max(1.0, rows - 1.0)
