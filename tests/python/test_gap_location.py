"""Location of the gap: Shapley shares add to one and lie in the subsystem of the effect; regimes;
what a remainder depends on.
"""

from dataclasses import replace

import numpy as np
import pytest

from gap_toy import Toy
from made_log import drive_log, rig
from test_gap_verdict import decided
from vgroove.gap import DiagnosisOptions, stages
from vgroove.gap.catalogue import BY_ID, CATALOGUE
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.regimes import regimes_of
from vgroove.gap.verdict import location, remainder


@pytest.mark.parametrize(
    "name,size,place",
    [
        ("winding_resistance.relative", 0.08, "motor_electrical"),
        ("coulomb_friction.torque_nm", 0.003, "motor_mechanical"),
        ("current_gain.relative", 0.06, "sensor_current"),
        ("speed_gain.relative", 0.01, "sensor_speed"),
        ("supply_resistance.resistance_ohm", 0.01, "supply"),
        ("transport_delay.delay_s", 0.003, "timing"),
    ],
)
def test_the_share_lies_where_the_effect_is(name: str, size: float, place: str) -> None:
    state, finding = decided(Toy({f"effects.{name}": size}))
    shares = location.shapley_shares(state, finding.best)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert max(shares, key=shares.get) == place and shares[place] > 0.9
    assert all(v >= 0.0 for v in shares.values())


def test_effects_in_two_subsystems_share_the_gap() -> None:
    state, finding = decided(
        Toy({"effects.coulomb_friction.torque_nm": 0.003, "effects.current_offset.offset_a": 0.5})
    )
    shares = location.shapley_shares(state, finding.best)
    assert shares["motor_mechanical"] > 0.2 and shares["sensor_current"] > 0.2
    assert sum(shares.values()) == pytest.approx(1.0)


@pytest.mark.parametrize(("gain", "least"), [(0.03, 0.3), (0.06, 0.7)])
def test_a_cogging_torque_takes_no_share_of_the_current_sensor(gain: float, least: float) -> None:
    """The derivative by the number of periods grows with the angle: multiplied by that number it is
    a thousand times what the cogging torque changes.
    """
    ids = ("cogging_torque", "current_gain")
    cogging = {"torque_nm": 0.004, "periods_per_rev": 3.0, "phase_rad": 0.5}
    log = drive_log(rig(effects={ids[0]: cogging, ids[1]: {"relative": gain}}))
    others = [e.id for e in CATALOGUE if e.id not in ids]
    search = stages.begin_search(
        load_problem([log], rig(), threads=1), DiagnosisOptions(without=others)
    )
    (start, *_) = search.engine.hypotheses([BY_ID[i] for i in ids])
    x = np.array([3.0 / c.factors[0] if "periods" in c.name else 1.0 for c in start.coordinates])
    (best,) = search.fit_and_keep([replace(start, start=x)])
    without = location.residual_without_effects(search, best)
    assert np.std(without) == pytest.approx(np.std(search.nominal.residual), rel=0.02)
    assert location.shapley_shares(search, best)["sensor_current"] > least


def test_a_log_that_moves_at_both_ends_is_steady_there() -> None:
    time_s = 0.01 * np.arange(100)
    regime, names = regimes_of(time_s, np.full(100, 50.0), np.ones(100))
    assert {names[k] for k in regime} == {"steady, 40-60 rad/s"}


def test_shapley_of_a_known_game() -> None:
    worth = {frozenset(): 0.0, frozenset("a"): 1.0, frozenset("b"): 1.0, frozenset("ab"): 1.0}
    assert location.shapley(["a", "b"], worth, "a") == pytest.approx(0.5)
    worth[frozenset("ab")] = 3.0
    assert location.shapley(["a", "b"], worth, "b") == pytest.approx(1.5)


def test_a_remainder_that_depends_on_speed_is_significant_and_noise_is_not() -> None:
    toy = Toy({})
    state, finding = decided(toy)
    speed = np.tile(toy.measured_rows[1], 3)
    covariates = {"speed": speed, "time": toy.time_s}
    assert not remainder.remaining(state, finding.best, covariates).significant
    held = finding.best.out_of_fold
    finding.best.out_of_fold = held + 2.0 * np.sin(speed / 1500.0) * (toy.signal == 1)
    left = remainder.remaining(state, finding.best, covariates)
    assert (left.significant, left.best_correlate, left.signal) == (True, "speed", "speed_rpm")


def test_the_shares_of_the_regimes_add_to_one() -> None:
    toy = Toy({"effects.coulomb_friction.torque_nm": 0.003})
    state, _ = decided(toy)
    parts = location.regime_shares(state)
    assert sum(p.share for p in parts) == pytest.approx(1.0, abs=0.02)
