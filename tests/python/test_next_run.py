"""The run that a verdict proposes: whether the tool is capable of it, and whether its points are a
command. Performed by the AVR firmware, it decides between two effects that one log cannot
distinguish.
"""

import numpy as np
import pytest

from made_log import rig
from test_board_run import HELD, RIG, Line
from test_run import elf
from vgroove import _core, lockstep
from vgroove.board import AvrBoard
from vgroove.errors import VgrooveError
from vgroove.gap import diagnose
from vgroove.gap.next_run.experiment_design import (
    goes_both_ways,
    predictions,
    repeating_run,
    runs_of,
)
from vgroove.gap.next_run.menu import PROFILE_S, profile_from_verdict, time_grid
from vgroove.gap.residual.loading import load_problem
from vgroove.guided_run import GuidedRun
from vgroove.log import Log, log_from_session, log_from_stream
from vgroove.recorder import RUN_COMPLETE
from vgroove.rig import read_rig
from vgroove.scenario import CURRENT_SAMPLES_PER_ROW, make_plant, without_board_effects

EFFECT = {"viscous_friction": {"nm_s_per_rad": 2e-6}}
ONE_SPEED = ((0.0, 0.0), (0.6, 0.0), (0.62, 0.5))


def recorded(travel: tuple, seconds: float, line: Line | None, seed: int) -> Log:
    """Log that the ELF of the firmware sends of a tool with the effect; travel: of the trigger."""
    sensors = read_rig(RIG).sensors
    noise_a, noise_v = (
        sensors["current_noise_a"] * CURRENT_SAMPLES_PER_ROW**0.5,
        sensors["supply_noise_v"],
    )
    front = lockstep.FrontEnds(current_noise_a=noise_a, supply_noise_v=noise_v)
    tool = make_plant(without_board_effects(read_rig(RIG)).with_effects(EFFECT), 1)
    with AvrBoard(elf()) as board:
        sent = lockstep.run(
            board,
            tool,
            lockstep.Profile(travel=travel),
            seconds,
            lockstep.LockstepOptions(front=front, line=line, seed=seed),
        )
    return log_from_stream(sent, "ELF")


@pytest.mark.proof
def test_the_run_that_a_verdict_proposes_decides_what_one_log_leaves_undecided() -> None:
    one = recorded(ONE_SPEED, 2.6, None, 1)
    undecided = diagnose([one], read_rig(RIG)).as_dict()
    assert undecided["verdict"] == "ambiguous"
    assert "viscous_friction" in [
        *undecided["selected"],
        *(rival["id"] for rival in undecided["indistinguishable"]),
    ]
    proposed = undecided["next_experiment"]
    separations = [s["sigma"] for s in proposed["separation"]]
    assert proposed["separation"][0]["profile"] == proposed["profile"]
    assert separations == sorted(separations, reverse=True)
    assert separations[0] > 2.0 * separations[-1]
    line = Line("staircase")
    line.run = GuidedRun(profile_from_verdict(undecided, "verdict"), line.session)
    recorded(HELD, 7.2, line, 2)
    two = log_from_session(line.session, "next")
    assert line.run.ended == RUN_COMPLETE and np.ptp(two["speed_rpm"]) > 5000.0
    both = diagnose([one, two], read_rig(RIG)).as_dict()
    assert (both["verdict"], both["selected"]) == ("effect", ["viscous_friction"])


@pytest.mark.parametrize(
    ("values", "both"),
    [
        (np.r_[np.ones(500), -0.2 * np.ones(500)], True),
        (np.r_[np.ones(500), np.full(500, np.nan), -0.1 * np.ones(10)], True),
        (np.r_[np.ones(999), [-0.9]], False),  # one sample
        (np.abs(np.sin(np.arange(1000.0))) - 0.03, False),  # noise around 0
        (np.full(9, np.nan), False),
    ],
)
def test_a_tool_goes_both_ways_where_it_does_so_for_more_than_an_event(
    values: np.ndarray, both: bool
) -> None:
    assert goes_both_ways(values) is both


def proposing(points: object) -> dict:
    return {"next_experiment": {"profile": "staircase", "points": points}}


@pytest.mark.parametrize(
    "points", [[[0, 0], [4, 0]], [[0, 0]], [[1, 0], [2, 1]], [[0, 0], [0, 1]], [[0, 0], [5, 1]]]
)
def test_points_without_drive_or_order_are_refused(points: list[list[float]]) -> None:
    with pytest.raises(VgrooveError, match="verdict.json: points .* are not all 0"):
        profile_from_verdict(proposing(points), "verdict.json")


@pytest.mark.parametrize(
    "points",
    [
        [[0, 0], [float("nan"), 0.5]],
        [[0, 0], [1, float("inf")]],
        [[0, 0.5, 1], [1, 2, 0.5]],  # three numbers each
        [0, 0, 1, 1],  # no pairs
        [[[0, 0], [1, 1]]],
        [[0, 0], [1]],
        [["0", "0"], ["1", "1"]],
        [],
        [[], []],
        None,
        "ab",
        {"0": 1},
    ],
)
def test_points_that_are_no_pairs_of_numbers_are_refused(points: object) -> None:
    with pytest.raises(VgrooveError, match="verdict.json: points .* pairs .* finite numbers"):
        profile_from_verdict(proposing(points), "verdict.json")


def test_the_points_of_a_verdict_are_those_of_its_run() -> None:
    run = profile_from_verdict(proposing([[0, 0], [0.2, 1], [4, -0.5]]), "verdict.json")
    assert (run.time_s, run.level) == ((0.0, 0.2, 4.0), (0.0, 1.0, -0.5))
    assert profile_from_verdict({"next_experiment": {"profile": "staircase"}}, "v").points()


@pytest.mark.parametrize("interval_s", [1e-6, 1e-3, 0.00100000001, 0.3, 0.7, 1.0, 7.9, 8.1, 1e3])
def test_a_run_has_rows_within_its_time_whatever_the_interval(interval_s: float) -> None:
    time_s = time_grid(interval_s)
    assert len(time_s) >= 4 and 0.0 < time_s[0] and time_s[-1] <= PROFILE_S * (1.0 + 1e-5)
    within = min(max(interval_s, 1e-3), 1.0)
    assert np.allclose(np.diff(time_s, prepend=0.0), within)
    assert time_s[-1] > PROFILE_S - 1.01 * within


@pytest.mark.parametrize("interval_s", [1.0, 2.0, 10.0])
def test_a_run_is_predicted_and_asks_for_faster_rows_after_a_slow_log(interval_s: float) -> None:
    tool = rig(sensors={"hall_pulses_per_rev": 0, "log_hz": 1.0 / interval_s})
    time_s = interval_s * np.arange(80)
    duty = np.repeat([0.2, 0.5, 0.8, 0.4], 20)
    drive = _core.LogInput(time_s, "duty", duty)
    rows = _core.simulate_log(drive, tool.parameters()[None], np.array([0]), np.zeros((1, 3)))
    columns = {"duty": duty, "current_a": rows["current_a"][0], "supply_v": rows["supply_v"][0]}
    problem = load_problem([Log(time_s, columns, "slow")], tool)
    for run in runs_of(problem):
        shown = predictions(problem, run, problem.theta0[None])
        assert shown.shape == (1, 8) and np.isfinite(shown).all(), run.name
    why = repeating_run(problem, None).why
    assert ("rows 1 s apart at most: those of the logs are" in why) == (interval_s > 1.0)
