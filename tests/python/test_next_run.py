"""The run that a verdict proposes: whether the tool is capable of it, and whether its points are a
command. Performed by the AVR firmware, it decides between two effects that one log cannot
distinguish.
"""

import numpy as np
import pytest

from test_board_run import HELD, RIG, Line
from test_run import elf
from vgroove import lockstep
from vgroove.board import AvrBoard
from vgroove.errors import VgrooveError
from vgroove.gap import diagnose
from vgroove.gap.next_run.experiment_design import goes_both_ways
from vgroove.gap.next_run.menu import profile_from_verdict
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


@pytest.mark.parametrize(
    "points", [[[0, 0], [4, 0]], [[0, 0], [float("nan"), 0.5]], [[0, 0], [1, float("nan")]]]
)
def test_points_without_drive_or_number_are_refused(points: list[list[float]]) -> None:
    asked = {"next_experiment": {"profile": "staircase", "points": points}}
    with pytest.raises(VgrooveError, match="are not all 0"):
        profile_from_verdict(asked, "verdict.json")
