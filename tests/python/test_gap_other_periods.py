"""A periodic effect is established only where torques of other periods close clearly less."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from made_log import MadeLog, held_run
from vgroove.gap.catalogue import BY_ID
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.single_effects import fit_single_effects
from vgroove.gap.stages import begin_search
from vgroove.gap.verdict import other_periods
from vgroove.gap.verdict.established import Member
from vgroove.rig import Rig, rig_from_dict

ROW_S, ROWS, FINE, LEVEL_ROWS = 0.005, 600, 8, 100
STEP_RAD, NOISE_RAD = 0.002, 0.001
DISTURBANCE_V = 0.3


def servo(effects: dict[str, dict[str, float]] | None = None) -> Rig:
    """Rig of a geared motor with a finely resolved angle."""
    return rig_from_dict(
        {
            "schema": "vgroove.rig/1",
            "input": {"kind": "voltage_v", "hold": "after"},
            "motor": {
                "resistance_ohm": 5.0,
                "inductance_h": 1e-3,
                "torque_constant_nm_per_a": 0.6,
                "inertia_kg_m2": 0.002,
                "viscous_nm_s_per_rad": 0.0,
                "coulomb_nm": 0.05,
            },
            "gearbox": {"ratio": 1.0, "output_inertia_kg_m2": 0.0},
            "mechanism": {"kind": "none"},
            "load": {"kind": "none"},
            "sensors": {"log_hz": 1.0 / ROW_S, "position_lsb_rad": STEP_RAD},
            "effects": effects or {},
        },
        "a servo",
    )


def drawn_log(tool: Rig, rng: np.random.Generator, disturbance_v: float = 0.0) -> MadeLog:
    """Log of steps of a drawn voltage. disturbance_v: size of a sum of drawn sines in time that
    acts as well and is not in the log.
    """
    time_s = ROW_S * np.arange(ROWS + 1)
    levels = rng.uniform(4.0, 12.0, ROWS // LEVEL_ROWS + 1)
    levels[rng.random(len(levels)) < 0.3] *= -1.0
    command = np.repeat(levels, LEVEL_ROWS)[: ROWS + 1]
    rates = 2.0 * np.pi * rng.uniform(0.3, 6.0, 16)[:, None]
    hidden = disturbance_v * np.sin(rates * time_s + rng.uniform(0.0, 6.0, (16, 1))).sum(axis=0)
    angle = held_run(tool, command + hidden, ROW_S, FINE)["angle_rad"][::FINE]
    noisy = angle + NOISE_RAD * rng.standard_normal(ROWS + 1)
    return MadeLog(
        time_s, {"voltage_v": command, "position_rad": np.round(noisy / STEP_RAD) * STEP_RAD}
    )


def cogging_alone(log: MadeLog) -> Member:
    """A fitted cogging torque as the only effect of a set."""
    search = begin_search(load_problem([log], servo()), DiagnosisOptions())
    search = fit_single_effects(replace(search, effects=[BY_ID["cogging_torque"]]))
    return Member(search, search.fits[("cogging_torque",)], "cogging_torque", {})


@pytest.mark.parametrize("seed", range(4))
def test_a_true_ripple_needs_its_period(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, periods = float(rng.uniform(0.03, 0.15)), float(rng.integers(1, 7))
    true = {"torque_nm": size, "periods_per_rev": periods, "phase_rad": float(rng.uniform(0.0, 6))}
    found = cogging_alone(drawn_log(servo({"cogging_torque": true}), rng))
    assert found.gain > 1.0 and found.needs_its_period


def test_of_a_torque_that_does_not_repeat_other_periods_mostly_close_as_much() -> None:
    """Over few turns a single period may follow it better by chance."""
    drawn = [drawn_log(servo(), np.random.default_rng(s), DISTURBANCE_V) for s in range(8)]
    assert sum(not cogging_alone(log).needs_its_period for log in drawn) >= 5


@given(own=st.floats(0.05, 200.0), turns=st.floats(0.1, 2000.0))
@example(own=1.0, turns=0.3)
def test_other_periods_differ_by_a_period_over_the_log(own: float, turns: float) -> None:
    counts = other_periods.other_counts(own, turns)
    assert all(abs(count - own) * turns >= 1.0 for count in counts)
    widest = own * (other_periods.OTHER.largest_ratio - 1.0) * turns
    assert len(counts) > 0 if widest > 1.01 else len(counts) == 0 or widest > 0.99


def test_an_effect_without_a_period_needs_none() -> None:
    found = cogging_alone(drawn_log(servo(), np.random.default_rng(0)))
    assert other_periods.needs_its_period(
        found.search, found.best, "coulomb_friction", found.without, 0.0
    )
