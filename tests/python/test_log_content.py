"""What logs can show: what repeats with an angle, and the forms of a lag of their speed."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gap_toy import SCALES
from vgroove.gap.catalogue import BY_ID, CATALOGUE, FORMS_BEYOND_SPECIFICATION, MIN_PERIODS
from vgroove.gap.selection.intervals import catalogue_forms
from vgroove.gap.selection.log_content import repeats, turned
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
    return SimpleNamespace(logs=logs, rig=SimpleNamespace(gearbox={"ratio": RATIO}))


def test_a_log_turns_between_its_outermost_angles() -> None:
    assert turned(problem(3.0, 7.0)) == pytest.approx(7.0, rel=1e-3)
    assert turned(problem(9.0, 7.0)) == pytest.approx(9.0, rel=1e-3)


@pytest.mark.parametrize("effect", [e for e in CATALOGUE if e.periodic], ids=lambda e: e.id)
def test_what_repeats_is_looked_for_where_it_does_so_twice(effect: object) -> None:
    """Eccentric gears repeat once a turn of the output, an eccentric wheel once a motor turn."""
    if effect.periodic.is_fitted:
        assert repeats(effect, problem(0.01))
        return
    turns = MIN_PERIODS / effect.periodic.periods_per_rev({}.get, RATIO)
    assert not repeats(effect, problem(0.99 * turns))
    assert repeats(effect, problem(1.01 * turns))


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
