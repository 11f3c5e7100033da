"""Where: shares that add to one and sit where the effect is, sensors not mistaken for physics, and
what a remainder follows.
"""

import numpy as np
import pytest

from gap_toy import Toy
from test_gap_verdict import FLOOR, decided
from vgroove.gap.verdict import location


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
    shares = location.shapley_shares(state, finding.best, FLOOR)
    assert sum(shares.values()) == pytest.approx(1.0)
    assert max(shares, key=shares.get) == place and shares[place] > 0.9
    assert all(v >= 0.0 for v in shares.values())


def test_two_places_share() -> None:
    state, finding = decided(
        Toy({"effects.coulomb_friction.torque_nm": 0.003, "effects.current_offset.offset_a": 0.5})
    )
    shares = location.shapley_shares(state, finding.best, FLOOR)
    assert shares["motor_mechanical"] > 0.2 and shares["sensor_current"] > 0.2
    assert sum(shares.values()) == pytest.approx(1.0)


def test_shapley_of_a_known_game() -> None:
    worth = {frozenset(): 0.0, frozenset("a"): 1.0, frozenset("b"): 1.0, frozenset("ab"): 1.0}
    assert location.shapley(["a", "b"], worth, "a") == pytest.approx(0.5)
    worth[frozenset("ab")] = 3.0
    assert location.shapley(["a", "b"], worth, "b") == pytest.approx(1.5)


def test_a_remainder_that_follows_speed_is_found_and_noise_is_not() -> None:
    toy = Toy({})
    state, finding = decided(toy)
    speed = np.tile(toy.measured_rows[1], 3)
    drivers = {"speed": speed, "time": toy.time_s}
    names = ["current_a", "speed_rpm", "supply_v"]
    assert not location.remaining(
        state, finding.best, drivers, toy.signal, names, FLOOR
    ).significant
    held = finding.best.held
    finding.best.held = held + 2.0 * np.sin(speed / 1500.0) * (toy.signal == 1)
    left = location.remaining(state, finding.best, drivers, toy.signal, names, FLOOR)
    assert (left.significant, left.best_correlate, left.signal) == (True, "speed", "speed_rpm")


def test_regimes_hold_the_whole_gap() -> None:
    toy = Toy({"effects.coulomb_friction.torque_nm": 0.003})
    state, _ = decided(toy)
    parts = location.by_regime(state, toy.regime, toy.regimes)
    assert sum(p["share"] for p in parts) == pytest.approx(1.0, abs=0.02)
