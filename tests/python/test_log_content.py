"""What logs can show: what repeats with an angle, and the forms of a lag of their speed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gap_toy import SCALES
from made_log import drive_log, rig
from vgroove.gap.catalogue import BY_ID, CATALOGUE, FORMS_BEYOND_SPECIFICATION, MIN_PERIODS
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.selection.intervals import catalogue_forms
from vgroove.gap.selection.log_content import (
    effect_scales,
    has_range,
    periods_of_rows,
    repeats,
    resolved_periods,
    turned,
)
from vgroove.units import TURN_RAD

RATIO = 5.0


def problem(*turns: float) -> SimpleNamespace:
    """Logs in which the shaft turns forth and back by so many turns, with an angle or a speed."""
    logs = []
    for k, most in enumerate(turns):
        time_s = np.linspace(0.0, 2.0, 2001)
        angle = TURN_RAD * most * np.sin(np.pi * time_s / 2.0)
        speed = {"speed_rpm": np.gradient(angle, time_s) * 60.0 / TURN_RAD}
        columns = {"position_rad": angle} if k % 2 else speed
        logs.append(SimpleNamespace(time_s=time_s, columns=columns))
    rig = SimpleNamespace(gearbox={"ratio": RATIO}, mechanism={"kind": "none"})
    signals = [SimpleNamespace(column="speed_rpm", edges=False)]
    return SimpleNamespace(logs=logs, rig=rig, signals=signals)


def test_a_log_turns_between_its_outermost_angles() -> None:
    assert turned(problem(3.0, 7.0)) == pytest.approx(7.0, rel=1e-3)
    assert turned(problem(9.0, 7.0)) == pytest.approx(9.0, rel=1e-3)


@pytest.mark.parametrize("effect", [e for e in CATALOGUE if e.periodic], ids=lambda e: e.id)
def test_what_repeats_is_looked_for_where_it_does_so_twice(effect: object) -> None:
    """Eccentric gears repeat once a turn of the output, an eccentric wheel once a motor turn."""
    assert has_range(effect, replace(SCALES, turns=0.01))
    if effect.periodic.is_fitted:
        assert not has_range(effect, replace(SCALES, turns=100.0, periods=0.19))
        assert has_range(effect, replace(SCALES, turns=100.0, periods=0.21))
        return
    known = effect.periodic.periods_per_rev({}.get, RATIO)
    here = replace(SCALES, ratio=RATIO, repeated_turns=1.01 * MIN_PERIODS / known, periods=known)
    assert repeats(effect, here)
    assert not repeats(effect, replace(here, repeated_turns=0.99 * MIN_PERIODS / known))
    assert not repeats(effect, replace(here, periods=0.99 * known))


@pytest.mark.parametrize("turns_a_row", [1e-4, 0.013, 0.5, 17.0])
@pytest.mark.parametrize("rows", [1, 2, 40])
def test_rows_at_a_constant_speed_resolve_a_period_of_a_row(turns_a_row: float, rows: int) -> None:
    """Provided that there are rows for MIN_PERIODS periods of one row each."""
    found = periods_of_rows(np.full(rows, turns_a_row))
    assert found == pytest.approx(1.0 / turns_a_row if rows >= MIN_PERIODS else 0.0)


def test_the_slow_rows_of_a_run_up_resolve_more_periods_than_the_fast_ones() -> None:
    run_up = np.linspace(0.0, 4.0, 401)[1:]
    found = periods_of_rows(np.random.default_rng(1).permutation(run_up))
    passing = found * run_up[found * run_up <= 1.0 + 1e-9]
    assert found > 1.0 / run_up.max() and passing.sum() >= MIN_PERIODS
    more = 1.01 * found * run_up
    assert more[more <= 1.0].sum() < MIN_PERIODS


def fast_motor(held_rows: int = 1) -> SimpleNamespace:
    """A log with a row every 27 ms of a motor at 600 turns per second. held_rows: rows between two
    samples of the speed.
    """
    fast = problem(1.0)
    time_s = 0.027 * np.arange(100.0)
    fast.logs[0].time_s = time_s
    fast.logs[0].columns["speed_rpm"] = np.full(100, 36_000.0)
    fast.time_s, fast.log = time_s[::held_rows], np.zeros(len(time_s[::held_rows]), int)
    return fast


@pytest.mark.parametrize("held_rows", [1, 4])
def test_what_is_sampled_more_slowly_resolves_less(held_rows: int) -> None:
    found = resolved_periods(fast_motor(held_rows))
    assert found == pytest.approx(1.0 / (600.0 * 0.027 * held_rows))


@pytest.mark.parametrize(("column", "edges"), [("position_rad", False), ("speed_rpm", True)])
def test_a_measured_angle_resolves_any_period(column: str, edges: bool) -> None:
    fast = fast_motor()
    fast.signals.append(SimpleNamespace(column=column, edges=edges))
    assert resolved_periods(fast) == np.inf


def test_without_a_logged_motion_no_period_is_left_out() -> None:
    fast = fast_motor()
    del fast.logs[0].columns["speed_rpm"]
    assert resolved_periods(fast) == np.inf


@pytest.mark.parametrize(("turns", "least"), [(1e6, 0.2), (4.0, 0.5), (0.5, 4.0), (0.0, 2e4)])
def test_a_fitted_period_repeats_twice_in_the_log(turns: float, least: float) -> None:
    (periods,) = (p for p in BY_ID["cogging_torque"].parameters if p.name == "periods_per_rev")
    assert periods.low(replace(SCALES, turns=turns)) == pytest.approx(least)
    assert periods.low_is_convention  # a fit that ends there is no effect


@pytest.mark.parametrize(
    ("changes", "forms"), [({}, 3), ({"edges": True}, 2), ({"hammering": True}, 2)]
)
def test_a_mean_is_no_form_of_a_speed_that_is_made_from_edges(
    changes: dict[str, bool], forms: int
) -> None:
    assert len(BY_ID["speed_lag"].of_tool(replace(SCALES, **changes)).forms) == forms


def test_forms_beyond_the_agreed_catalogue_are_replaced_by_all_others_of_their_effects() -> None:
    columns = {name: n for n, (name, _) in enumerate(sorted(FORMS_BEYOND_SPECIFICATION))}
    beyond = {(columns[name], value) for name, value in FORMS_BEYOND_SPECIFICATION}
    dead, lag = columns["effects.dead_time.at_edges"], columns["effects.speed_lag.lag_form"]
    assert catalogue_forms(((lag, 1.0),), beyond) == [((lag, 1.0),)]
    assert catalogue_forms(((lag, 2.0),), beyond) == [(), ((lag, 1.0),)]
    both = catalogue_forms(((7, 1.0), (dead, 1.0), (lag, 2.0)), beyond)
    assert both == [((7, 1.0),), ((7, 1.0), (lag, 1.0))]


@pytest.mark.parametrize("limit_a", [4.0, 8.0, 12.0])
def test_a_current_sensor_shows_no_more_than_its_limit(limit_a: float) -> None:
    """The limit of a clipped log is not excluded, one that a log exceeds is."""
    effect, made = BY_ID["current_saturation"], drive_log(rig())
    noise = 0.15 * np.random.default_rng(2).standard_normal(len(made.time_s))
    clipped = np.clip(made.columns["current_a"], -limit_a, limit_a) + noise
    for current, least in ((made.columns["current_a"], limit_a), (clipped, 0.9 * limit_a)):
        log = replace(made, columns=made.columns | {"current_a": current})
        scales = effect_scales(load_problem([log], rig()))
        low = effect.leading.low(scales)
        assert low == effect.leading.widest_low(scales) > least
    assert low <= limit_a
