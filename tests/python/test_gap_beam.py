"""Several effects at once, of which none closes much alone: the beam search finds them where
forward selection does not. A motor with a propeller on a test stand whose controller answers late.
"""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from made_log import drive_log, rig
from vgroove import _core
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.selection import beam
from vgroove.gap.selection.options import DiagnosisOptions
from vgroove.gap.selection.search import select
from vgroove.gap.selection.search_state import Search, SearchCache
from vgroove.gap.stages import begin_search
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict
from vgroove.units import RPM_PER_RAD_S

ROW_S, NOISE_RPM = 0.0227, 10.0
STAND = {
    "schema": "vgroove.rig/1",
    "name": "propeller on a stand",
    "input": {"kind": "voltage_v", "hold": "after"},
    "supply": {"voltage_v": 16.0, "resistance_ohm": 0.0},
    "motor": {
        "resistance_ohm": 0.1,
        "inductance_h": 1e-5,
        "torque_constant_nm_per_a": 0.00415,
        "inertia_kg_m2": 9e-6,
        "viscous_nm_s_per_rad": 0.0,
        "coulomb_nm": 0.0,
    },
    "gearbox": {"ratio": 1.0, "output_inertia_kg_m2": 0.0},
    "mechanism": {"kind": "none"},
    "load": {"kind": "none"},
    "sensors": {"log_hz": 44, "speed_lsb_rpm": 1.0, "speed_noise_rpm": NOISE_RPM},
    "tolerance": {"motor.resistance_ohm": 0.3, "motor.torque_constant_nm_per_a": 0.03},
}
# levels of a log: (time in s, voltage in V)
Levels = tuple[tuple[float, float], ...]
RUNS: tuple[Levels, ...] = (((0.0, 0.0), (0.3, 2.0)), ((0.0, 4.7), (0.6, 7.4)))
ENDS_S = (1.5, 2.6)


def drawn_tool(seed: int) -> Rig:
    """The stand with a propeller's drag, a constant friction and a delay, drawn from ranges."""
    rng = np.random.default_rng(seed)
    effects = {
        "quadratic_drag": {"nm_s2_per_rad2": rng.uniform(1e-8, 2.5e-8)},
        "coulomb_friction": {"torque_nm": rng.uniform(0.008, 0.02)},
        "transport_delay": {"delay_s": rng.uniform(0.045, 0.09)},
    }
    return rig_from_dict(STAND | {"effects": effects}, "the stand as it is")


def stand_log(tool: Rig, levels: Levels, end_s: float, rng: np.random.Generator) -> Log:
    """A log of a tool with the noise of the stand."""
    fine = np.arange(0.0, end_s, ROW_S / 16)
    volts = np.array([v for _, v in levels])
    command = volts[np.searchsorted([t for t, _ in levels], fine, side="right") - 1]
    start = np.array([[np.nan, command[0] / 0.00415 * 0.8, 0.0]])
    drive = _core.LogInput(fine, "voltage_v", command)
    rows = _core.simulate_log(drive, tool.parameters()[None], np.array([0]), start)
    speed = rows["speed_rad_s"][0, ::16] * RPM_PER_RAD_S
    speed = np.round(speed + NOISE_RPM * rng.standard_normal(len(speed)))
    return Log(fine[::16], {"voltage_v": command[::16], "speed_rpm": speed}, "stand")


def begun(seed: int) -> Search:
    """A search with the rig of the stand on two logs of a drawn tool."""
    tool, rng = drawn_tool(seed), np.random.default_rng(seed)
    logs = [stand_log(tool, levels, end, rng) for levels, end in zip(RUNS, ENDS_S, strict=True)]
    return begin_search(load_problem(logs, rig_from_dict(STAND, "stand")), DiagnosisOptions())


def test_a_delay_beside_two_losses_is_found_in_logs_of_few_steps() -> None:
    """Without the beam search the selection of this draw is torque_constant, gap 28."""
    selection = select(begun(5))
    found = set(selection.best.ids)
    assert {"quadratic_drag", "transport_delay"} < found
    assert found & {"coulomb_friction", "stribeck_friction"}
    assert selection.search.reported_gap(selection.best) < 5.0


class Blocked:
    """A search of so many blocks in which every set leaves so large a gap."""

    def __init__(
        self, blocks: int, is_far: bool = True, hammers: bool = False, balance: bool = False
    ) -> None:
        self.blocks = SimpleNamespace(count=blocks)
        self.is_far_from_noise = lambda _: is_far
        self.problem = SimpleNamespace(sigma_is_bound=hammers)
        self.gap_problem = SimpleNamespace() if balance else None
        self.engine = SimpleNamespace(closest=list)
        self.fits: dict[tuple[str, ...], object] = {}
        self.asked = False

    def progress(self, _: str) -> None:
        """Called when the beam search begins."""
        self.asked = True

    def reported_share(self, _: object) -> float:
        """Nothing is closed."""
        return 0.0

    def ranked(self) -> list[SimpleNamespace]:
        """The empty set alone."""
        return [SimpleNamespace(ids=())]


FEW = beam.BEAM.max_blocks


@pytest.mark.parametrize(
    ("given", "closed_by_all", "begins"),
    [
        ({}, 0.8, True),
        ({"blocks": FEW + 1}, 1.0, False),
        ({"is_far": False}, 1.0, False),
        ({"hammers": True}, 1.0, False),
        ({"balance": True}, 1.0, False),
        ({}, 0.79, False),
    ],
)
def test_a_beam_search_begins_far_from_the_noise_in_few_blocks(
    given: dict, closed_by_all: float, begins: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And where all effects together close enough."""
    state = Blocked(**{"blocks": FEW} | given)
    monkeypatch.setattr(beam, "closed_by_all_effects", lambda *_: closed_by_all)
    best = SimpleNamespace(ids=("a",))
    assert beam.search_from_several_sets(state, best) == (state, best)
    assert state.asked is begins


@pytest.mark.parametrize(
    ("left", "closed", "taken"), [(4.9, 0.95, True), (5.0, 0.95, False), (4.9, 0.94, False)]
)
def test_a_set_is_taken_where_it_closes_nearly_all_and_leaves_less(
    left: float, closed: float, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Otherwise the sets that the beam search has fitted are forgotten."""
    state, best = Blocked(1), SimpleNamespace(ids=("a",))
    monkeypatch.setattr(beam, "closed_by_all_effects", lambda *_: 1.0)
    found = SimpleNamespace(ids=("b", "c"))

    def fitted(search: Blocked) -> SimpleNamespace:
        search.fits[found.ids] = found
        return found

    state.fits = {best.ids: best}
    state.reported_gap = lambda one: left if one is found else 5.0
    state.reported_share = lambda _: closed
    monkeypatch.setattr(beam, "best_of_beam", fitted)
    monkeypatch.setattr(beam, "rescale", lambda _: "rescaled")
    wanted = ("rescaled", found) if taken else (state, best)
    assert beam.search_from_several_sets(state, best) == wanted
    assert (found.ids in state.fits) is taken


@pytest.mark.parametrize(
    ("friction_nm", "wave_a", "least", "most"), [(0.003, 0.0, 0.9, 1.01), (0.0, 0.8, 0.0, 0.5)]
)
def test_all_effects_together_close_a_listed_gap_and_no_oscillation(
    friction_nm: float, wave_a: float, least: float, most: float
) -> None:
    """A current that oscillates at 37 Hz is no effect of the catalogue, however large the set."""
    made = drive_log(
        rig(effects={"coulomb_friction": {"torque_nm": friction_nm}}),
        seconds=2.0,
        levels=[(0.2, 0.4), (0.8, 0.9), (1.4, 0.5)],
    )
    made.columns["current_a"] += wave_a * np.sin(2.0 * np.pi * 37.0 * made.time_s)
    search = begin_search(load_problem([made], rig()), DiagnosisOptions())
    assert least <= beam.closed_by_all_effects(search, search.retuned) <= most
    nothing = replace(search, effects=[], cache=SearchCache())
    assert beam.closed_by_all_effects(nothing, search.retuned) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(("size", "count"), [(1, beam.BEAM.singles), (2, beam.BEAM.width)])
def test_the_sets_that_fit_best_are_extended(
    size: int, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of one size with the smallest errors over all rows; invalid ones are left out."""
    monkeypatch.setattr(beam, "is_valid", lambda one: one.cost != 2.0)
    costs = np.random.default_rng(size).permutation(20).astype(float)
    fits = {("a", str(c))[-size:]: SimpleNamespace(ids=("a", str(c)), cost=c) for c in costs}
    fits |= {("x", "y", "z")[: 3 - size]: SimpleNamespace(ids=("z",), cost=0.0)}
    engine = SimpleNamespace(closest=lambda given: sorted(given, key=lambda one: one.cost))
    found = beam.best_fitting(SimpleNamespace(fits=fits, engine=engine), size)
    assert [f.cost for f in found] == [c for c in range(20) if c != 2][:count]
