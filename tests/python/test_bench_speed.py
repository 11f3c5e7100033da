"""`vgroove bench speed`: tool and peers' equations equal those of the independent reference, and
the timing treats all solvers alike.
"""

from __future__ import annotations

import importlib
import json
import math
import shutil
import sys
import types

import numpy as np
import pytest
from rich.console import Console

import impact_reference as reference
from vgroove import _core as core
from vgroove.bench import euler, timing
from vgroove.bench.impact_tool import RIG_KEYS, SLIPPING, head_rad, rest
from vgroove.bench.own import impact_log, impact_parameters

KEPT = json.loads(reference.RESULTS.read_text())["cases"]
# Field of the comparison's tool -> field of the reference's
NAMES = {
    "supply_v": "voc",
    "supply_ohm": "rs",
    "resistance_ohm": "r",
    "inductance_h": "l",
    "torque_constant": "kt",
    "motor_inertia": "jm",
    "viscous": "b",
    "coulomb_nm": "tc",
    "ratio": "n",
    "spindle_inertia": "jj",
    "hammer_inertia": "js",
    "hammer_kg": "m",
    "lead_m": "lead",
    "vertex_rad": "vertex",
    "travel_rad": "q_max",
    "preload_n": "f0",
    "rate_n_m": "k",
    "lug_height_m": "h",
    "lug_radius_m": "r_lug",
    "overlap_rad": "overlap",
    "contact_n_m": "ck",
    "contact_n_s_m": "cb",
    "ramp_m": "ramp",
    "anvil_inertia": "ja",
    "joint_nm_rad": "kj",
    "joint_nm_s_rad": "cj",
    "run_nm": "run_nm",
    "slope_nm_rad": "slope",
    "loosen_ratio": "loosen",
    "duty": "duty",
}


@pytest.mark.parametrize("case", SLIPPING)
def test_tool_has_the_values_of_the_reference(case: str) -> None:
    tool, other = SLIPPING[case], reference.CASES[case].tool()
    assert {name: getattr(tool, name) for name in NAMES} == {
        name: getattr(other, theirs) for name, theirs in NAMES.items()
    }
    assert tool.pitch_rad == pytest.approx(2 * math.pi / other.lugs)
    assert NAMES.keys() == vars(tool).keys() - {"pitch_rad"}
    assert RIG_KEYS.keys() == NAMES.keys() - {"duty"}


@pytest.fixture
def peers_derivative(monkeypatch: pytest.MonkeyPatch):  # noqa: ANN201
    """derivative() of the peers, interpreted where numba is not installed."""

    def njit(*args: object, **_options: object) -> object:
        return args[0] if args else lambda function: function

    monkeypatch.setitem(sys.modules, "numba", types.SimpleNamespace(njit=njit))
    monkeypatch.delitem(sys.modules, "vgroove.bench.impact_model", raising=False)
    yield importlib.import_module("vgroove.bench.impact_model").derivative
    sys.modules.pop("vgroove.bench.impact_model", None)


def states_of_reference(case: str, seconds: float):  # noqa: ANN201
    """State and derivative of the reference's run every 20 us, in all its modes and never at the
    boundary of one.
    """
    plant, out, y, t = (
        reference.Impact(reference.CASES[case].tool()),
        reference.Result(),
        np.zeros(11),
        0.0,
    )
    y[reference.THJ] = y[reference.THS] = -1.0
    while t < seconds:
        y, t, left = reference.stretch(plant, y, t, min(t + 2e-5, seconds), out, "DOP853", 1e-8)
        if left:
            plant.switch(y)
        else:
            yield y.copy(), plant.rhs(t, y)


@pytest.mark.parametrize("case", SLIPPING)
def test_peers_solve_the_references_equations(case: str, peers_derivative) -> None:  # noqa: ANN001
    order = [
        reference.I,
        reference.THJ,
        reference.WJ,
        reference.THS,
        reference.WS,
        reference.THA,
        reference.WA,
        reference.E,
    ]
    parameters, dy, seen = SLIPPING[case].vector(), np.empty(8), 0
    # a contact's edge moves forces by rounding of its penetration
    scale = np.array([1e5, 1e2, 1e5, 1e3, 1e6, 1e1, 1e6, 1e1])
    for y, expected in states_of_reference(case, 0.07):
        peers_derivative(y[order].copy(), dy, parameters)
        np.testing.assert_allclose(dy / scale, expected[order] / scale, rtol=1e-6, atol=1e-6)
        seen += 1
    assert seen > 3000


@pytest.mark.parametrize("case", SLIPPING)
def test_reference_of_the_comparison_is_the_independent_one(case: str) -> None:
    pytest.importorskip("numba", reason="numba is in the extra [bench]")
    speed = importlib.import_module("vgroove.bench.impact_speed")
    assert speed.reference_head(SLIPPING[case]) == pytest.approx(
        KEPT[case]["rows"][-1][8], rel=1e-6
    )


def test_casadis_expression_is_the_same_function(peers_derivative) -> None:  # noqa: ANN001
    casadi = pytest.importorskip("casadi", reason="casadi is in the extra [bench]")
    y, p, rates = importlib.import_module("vgroove.bench.casadi_model").expression()
    theirs, parameters, dy = (
        casadi.Function("rates", [y, p], [rates]),
        SLIPPING["slope_700"].vector(),
        np.empty(8),
    )
    # angle past a flank: touching, over the lug, at its end, free
    rng, near = np.random.default_rng(1), [0.0, 1e-3, 0.5, 0.99, 1.0, 1.5]
    for _ in range(2000):
        state = rng.normal(size=8) * [30, 3, 60, 0, 60, 0.005, 5, 0.02]
        state[3] = state[5] + np.pi * rng.integers(0, 3) + rng.choice(near) + 2e-4 * rng.normal()
        # hammer at any height, and near the lug height
        state[1] = state[3] + rng.choice([rng.normal(), 1.0715614 + 1e-2 * rng.normal()])
        peers_derivative(state, dy, parameters)
        np.testing.assert_allclose(
            np.array(theirs(state, parameters)).ravel(), dy, rtol=1e-9, atol=1e-6
        )


@pytest.mark.skipif(
    shutil.which("c++") is None and shutil.which("g++") is None, reason="no C++ compiler"
)
@pytest.mark.parametrize("case", SLIPPING)
def test_plain_euler_converges_to_the_reference(case: str) -> None:
    library, kept = euler.build(), KEPT[case]["rows"][-1]
    errors = [
        abs(
            head_rad(euler.run(library, rest(), SLIPPING[case].vector(), 1000, step)[-1]) / kept[8]
            - 1.0
        )
        for step in (2e-6, 2e-7)
    ]
    assert errors[0] < 2e-2
    assert errors[1] < 1e-3


def test_loosest_tolerance_that_reaches_both_joints_is_timed() -> None:
    speed = importlib.import_module("vgroove.bench.impact_speed")
    solvers = importlib.import_module("vgroove.bench.solvers")
    heads = {"slip_60": 2.0, "slope_700": 2.0}

    def run(times: np.ndarray, y0: np.ndarray, p: np.ndarray, rtol: float) -> np.ndarray:
        off = {1e-2: 0.5, 1e-3: 9e-4 if p[28] > 0 else 2e-3, 1e-4: 1e-3}.get(rtol, 0.0)
        return np.array([[0, 0, 0, 0, 0, 2.0 * (1.0 + off), 0, 0]])

    chosen = speed.choose(solvers.Peer("made", run, (1e-2, 1e-3, 1e-4, 1e-5)), heads)
    assert {case: choice.tolerance for case, choice in chosen.items()} == {
        "slip_60": 1e-4,
        "slope_700": 1e-4,
    }
    never = speed.choose(solvers.Peer("made", run, (1e-2, 1e-3)), heads)
    assert never["slip_60"].tolerance == 1e-3
    assert never["slip_60"].error == pytest.approx(2e-3)


def test_a_failing_solver_has_an_infinite_error() -> None:
    speed = importlib.import_module("vgroove.bench.impact_speed")
    solvers = importlib.import_module("vgroove.bench.solvers")

    def run(times: np.ndarray, y0: np.ndarray, p: np.ndarray, rtol: float) -> np.ndarray:
        raise RuntimeError("error test failed")

    chosen = speed.choose(solvers.Peer("made", run, (1e-3,)), {"slip_60": 2.0})
    assert chosen["slip_60"].error == math.inf


def test_solvers_run_in_turns_and_short_runs_are_repeated() -> None:
    order: list[str] = []
    works = {
        "long": lambda: order.append("long") or timing.time.sleep(0.06),
        "short": lambda: order.append("short"),
    }
    turns: list[str] = []
    seconds = timing.medians(works, 3, turns.append)
    assert turns == ["long", "short"] * 3
    assert order.count("long") == 2 + 3
    assert order.count("short") == 2 + 3 * timing.MAX_CALLS
    assert 0.05 < seconds["long"].wall < 0.5
    assert seconds["long"].cpu < 0.05
    assert seconds["short"].wall < 1e-3


def test_a_figure_without_its_peer_is_neither_met_nor_missed() -> None:
    speed = importlib.import_module("vgroove.bench.speed")
    assert speed.at_least("", None, 12.0).met is None
    assert speed.at_least("", 12.0, 12.0).met is True
    assert speed.at_least("", 11.99, 12.0).met is False
    assert speed.at_most("", 0.003, 0.003).met is True
    assert speed.at_most("", 0.0031, 0.003).met is False


def test_ratios_are_of_processor_time_on_the_joint_with_the_smallest() -> None:
    speed = importlib.import_module("vgroove.bench.speed")
    figure = importlib.import_module("vgroove.bench.impact_speed").Figure
    figures = [
        figure(speed.FAST, "slip_60", 9.0, 1.0, 0.0, True),
        figure(speed.FAST, "slope_700", 9.0, 2.0, 0.0, True),
        figure("peer", "slip_60", 9.0, 8.0, 0.0, True),
        figure("peer", "slope_700", 9.0, 8.0, 0.0, True),
    ]
    assert speed.worst_ratio(figures, "peer") == 4.0
    assert speed.worst_ratio(figures, "absent") is None
    assert speed.busy_share(figures) == pytest.approx(1.0 - 19.0 / 36.0)


def test_missing_peers_are_named_with_their_install_command(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    solvers = importlib.import_module("vgroove.bench.solvers")
    for name in ("numba", "casadi"):
        monkeypatch.setitem(sys.modules, name, None)
        monkeypatch.delitem(sys.modules, "vgroove.bench.casadi_model", raising=False)
        monkeypatch.delitem(sys.modules, "vgroove.bench.impact_peers", raising=False)
    found, missing = solvers.load_peers()
    assert {m.name for m in missing} >= {
        "numbalsoda LSODA",
        "CasADi CVODES",
        "SciPy LSODA",
        "scikit-sundae CVODE",
    }
    assert all("install" in m.install for m in missing)
    assert {p.name for p in found} <= {"C++ Euler", "C++ Euler at 2 us"}


def test_batch_tools_differ_and_are_the_same_for_a_seed() -> None:
    batch = importlib.import_module("vgroove.bench.batch_speed")
    tools = batch.different_tools(8, 3)
    assert tools == batch.different_tools(8, 3)
    assert len(set(tools)) == 8
    assert all(abs(tool.supply_v / SLIPPING["slip_60"].supply_v - 1.0) <= 0.03 for tool in tools)


def test_hall_column_is_one_pitch_over_the_last_edge_period() -> None:
    hall = importlib.import_module("vgroove.bench.hall_column")
    time_s = np.arange(101) * 1e-3
    angle, speed = 300.0 * time_s + 2000.0 * time_s**2, 300.0 + 4000.0 * time_s
    edges = hall.edge_times(time_s, angle, speed)
    np.testing.assert_allclose(
        300.0 * edges + 2000.0 * edges**2, np.arange(1, edges.size + 1) * np.pi / 2, rtol=1e-12
    )
    channel = hall.hall_channel(time_s, edges)
    row = int(np.flatnonzero(channel.row == 50)[0])
    before = edges[edges <= time_s[50]]
    assert channel.measured[row] == pytest.approx(np.pi / 2 / (before[-1] - before[-2]))
    shown = channel.model(
        {"angle_measured_rad": angle[None, :], "speed_measured_rad_s": speed[None, :]}
    )[0]
    np.testing.assert_allclose(shown, channel.measured, rtol=1e-12)


def made_impact() -> list[dict]:
    """Impact figures of two solvers, of which one does not reach the accuracy."""
    impact = {
        "name": "vgroove, fast",
        "case": "slip_60",
        "seconds": 2e-3,
        "cpu_seconds": 2e-3,
        "head_error": 1e-5,
        "reached": True,
        "tolerance": None,
        "tolerance_is": None,
        "ratio": 1.0,
    }
    missed = {"name": "far off", "reached": False, "tolerance": 2e-6, "tolerance_is": "step_s"}
    return [impact, impact | missed]


def made_figures() -> dict:
    """Figures of a run in which one peer is missing."""
    return {
        "cpu": "made",
        "cores": 2,
        "busy": 0.4,
        "repeats": 5,
        "drive_seconds": 10,
        "mujoco_step_s": None,
        "asked": [{"name": "impact", "value": None, "relation": ">=", "asked": 12.0, "met": None}],
        "impact": made_impact(),
        "tolerances": [
            {
                "name": "made peer",
                "case": "slope_700",
                "tolerance": 7e-5,
                "tolerance_is": "rtol",
                "head_error": 2e-3,
                "reached": False,
                "cpu_seconds": 1e-2,
                "ratio": 13.7,
            }
        ],
        "lockstep": [
            {
                "name": "vgroove, fast",
                "case": "slip_60",
                "alone_s": 2e-3,
                "lockstep_s": 2.1e-3,
                "extra": 0.05,
            }
        ],
        "batch": [
            {
                "name": "vgroove, fast",
                "rollouts": 512,
                "threads": 2,
                "per_second": 1000.0,
                "per_second_idle": 1200.0,
                "head_error": 1e-5,
            }
        ],
        "growth": [{"of": "time", "size": 1.0, "seconds_each": 2e-3}],
        "drive": [
            {
                "name": "vgroove",
                "seconds": 1e-3,
                "times_real_time": 1e4,
                "speed_error": 1e-5,
                "rtol": None,
                "ratio": 1.0,
            }
        ],
        "memory": [{"of": "impact", "seconds": 60, "log_mib": 6.5, "peak_mib": 7.5}],
        "missing": [{"name": "CasADi CVODES", "install": "pip install casadi"}],
    }


def test_ratio_at_the_cheapest_tolerance_that_reaches_both_joints() -> None:
    sensitivity = importlib.import_module("vgroove.bench.sensitivity")

    def row(case: str, tolerance: float, ratio: float, reached: bool) -> object:
        return sensitivity.ToleranceFigure(
            "made", case, tolerance, "rtol", 0.0, reached, 1e-2, ratio
        )

    rows = [
        row("slip_60", 1e-4, 9.0, False),
        row("slope_700", 1e-4, 8.0, True),
        row("slip_60", 7e-5, 13.0, True),
        row("slope_700", 7e-5, 12.5, True),
        row("slip_60", 5e-5, 14.0, True),
        row("slope_700", 5e-5, 15.0, True),
    ]
    assert sensitivity.least_ratio(rows, "made") == 12.5
    assert sensitivity.least_ratio(rows[:2], "made") is None
    assert sensitivity.least_ratio(rows, "another") is None


def test_every_tolerance_of_the_grid_is_run_beside_the_plant(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sensitivity = importlib.import_module("vgroove.bench.sensitivity")
    solvers = importlib.import_module("vgroove.bench.solvers")
    monkeypatch.setattr(sensitivity, "reference_head", lambda tool: 2.0)
    monkeypatch.setattr(
        sensitivity, "peer_head", lambda peer, tool, tolerance: 2.0 * (1.0 + 1e2 * tolerance)
    )
    speed, ticks = importlib.import_module("vgroove.bench.impact_speed"), []
    peers = [solvers.Peer("made", None, (1e-5, 1e-6)), solvers.Peer("of one step", None, (1e-5,))]
    chosen = [speed.Figure("made", case, 1.0, 1.0, 0.0, True, 1e-5, "rtol") for case in SLIPPING]
    found = sensitivity.measure_tolerances(
        lambda tool: lambda: sum(range(1000)), peers, chosen, 2, ticks.append
    )
    assert len(ticks) == sensitivity.runs_of(peers) == len(SLIPPING)
    assert [f.tolerance for f in found if f.case == "slip_60"] == [
        1e-5 * step for step in sensitivity.STEPS
    ]
    assert all(
        f.reached == (f.tolerance <= 1.001e-5) and f.head_error == pytest.approx(1e2 * f.tolerance)
        for f in found
    )


def test_tables_show_figures_and_missing_peers() -> None:
    tables = importlib.import_module("vgroove.bench.speed_tables")
    console = Console(width=200, record=True, file=open("/dev/null", "w", encoding="utf-8"))
    for table in tables.speed_tables(made_figures()):
        console.print(table)
    text = console.export_text()
    for shown in (
        "peer missing",
        "pip install casadi",
        "slip 60 N m",
        "2 us",
        "5.0 %",
        "40 %",
        "1000.0",
        "10,000",
        "7.5",
        "rtol 7e-05",
        "13.7",
    ):
        assert shown in text, shown


@pytest.mark.parametrize("of", ["impact", "drivetrain"])
def test_memory_of_a_run_is_bounded_by_its_log(of: str) -> None:
    memory = importlib.import_module("vgroove.bench.memory")
    found = memory.measure_memory((of,), (10, 60))
    assert [m.seconds for m in found] == [10, 60]
    assert found[1].log_mib > 5.5 * found[0].log_mib > 2.0
    assert 0.5 < memory.growth_over_log(found, of) < 2.0


def derivatives_of(seconds: float, tools: int) -> float:
    """Evaluations of the plant's derivative for `tools` tools over `seconds`: a measure of its work
    that does not depend on the machine.
    """
    log = impact_log(1.0, round(seconds * 1000))
    theta = np.repeat(impact_parameters(SLIPPING["slip_60"])[None, :], tools, axis=0)
    theta[:, core.PARAMETERS.index("supply.voltage_v")] *= np.linspace(0.98, 1.02, tools)
    return sum(
        one["derivatives"]
        for one in core.simulate_impact(log, theta, mode="fast", threads=2)["statistics"]
    )


def test_work_grows_linearly_with_time_and_batch() -> None:
    assert derivatives_of(6.0, 1) == pytest.approx(6.0 / 1.5 * derivatives_of(1.5, 1), rel=0.1)
    assert derivatives_of(1.0, 64) == pytest.approx(8.0 * derivatives_of(1.0, 8), rel=0.05)
