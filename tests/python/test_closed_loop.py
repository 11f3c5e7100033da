"""The firmware in closed loop with the simulated tool: a log of the same tool stays within the
simulation, that of another tool leaves it, and stays within that of the corrected rig.
"""

from functools import cache

import numpy as np
import pytest

from vgroove.control_bench.runs import pull, reference, sil_run
from vgroove.firmware_replay.assumed_firmware import AssumedFirmware
from vgroove.firmware_replay.closed_loop import (
    ROWS_APART,
    STATE_WIDTH,
    WIDTHS,
    Change,
    changes,
    closed_loop,
    fall_begin,
    measured_departure,
    reversed_rows,
    spread,
    state_departure,
    trigger_profile,
    trigger_share,
)
from vgroove.lockstep import interpolate_points
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict

MODES = ("duty", "sync", "screwing", "vibration", "torque")
WINDING = {"winding_resistance": {"relative": 0.25}}


def rig() -> Rig:
    return reference("hard_joint")


@cache
def board_log(mode: str, effects: tuple[str, ...] = (), **params: float) -> Log:
    """Log of a board on the tool, with its hammer and Hall sensor elsewhere than in the runs."""
    tool = rig().with_effects({name: WINDING[name] for name in effects})
    tool = tool.with_values({"mechanism.hammer_start_rad": -0.77})
    run = sil_run(
        tool, mode=mode, params=params, profile=pull(0.9, release_s=1.2), duration_s=1.4, seed=4711
    )
    rows = dict(run.telemetry)
    return Log(rows.pop("time_s"), rows, "board.csv")


@pytest.mark.parametrize("mode", MODES)
def test_a_log_of_the_same_tool_stays_within_the_simulation(mode: str) -> None:
    found = closed_loop(board_log(mode), rig(), rig(), AssumedFirmware(mode))
    assert found.nominal is None and not found.is_corrected
    assert found.as_dict() == {"nominal": None}
    assert found.sentence() == "in closed loop the log stays within the simulation of the rig."


@pytest.mark.parametrize("mode", MODES)
def test_a_log_of_another_tool_leaves_it_but_not_that_of_the_corrected_rig(mode: str) -> None:
    log, corrected = board_log(mode, ("winding_resistance",)), rig().with_effects(WINDING)
    found = closed_loop(log, rig(), corrected, AssumedFirmware(mode))
    assert found.corrected is None and found.is_corrected
    assert found.nominal.signal in WIDTHS and 0.3 < found.nominal.time_s < 1.2
    row = round(found.nominal.time_s / 1e-3) - 1
    assert found.as_dict()["nominal"]["logged"] == log[found.nominal.signal][row]
    assert found.as_dict()["corrected"] is None
    assert "leaves the simulation of the rig at 0." in found.sentence()
    assert found.sentence().endswith("stays within that of the corrected rig.")


def test_another_parameter_of_the_firmware_is_no_gap_of_the_plant() -> None:
    """Neither the rig nor a corrected one gives the log; with the parameter the rig does."""
    log = board_log("duty", slew_per_ms_q15=0.003)
    found = closed_loop(log, rig(), rig(), AssumedFirmware("duty"))
    assert found.nominal.signal in ("duty", "current_a") and found.nominal.time_s < 0.4
    right = AssumedFirmware("duty", {"slew_per_ms_q15": 0.003})
    assert closed_loop(log, rig(), rig(), right).nominal is None


@pytest.mark.parametrize("pulses", [1, 2])
def test_a_board_with_another_hall_sensor_is_simulated_with_its_own(pulses: int) -> None:
    tool = rig().with_values({"sensors.hall_pulses_per_rev": pulses})
    params = {"hall_pulses": pulses}
    run = sil_run(tool, params=params, profile=pull(0.9), duration_s=1.0, seed=4711)
    rows = dict(run.telemetry)
    log = Log(rows.pop("time_s"), rows, "board.csv")
    assumed = AssumedFirmware("duty", params)
    assert closed_loop(log, tool, tool, assumed).nominal is None
    unstated = rig_without_pulses()
    assert closed_loop(log, unstated, unstated, assumed).nominal is None


def rig_without_pulses() -> Rig:
    """The tool's rig without its Hall sensor: the firmware's parameter states it."""
    data = rig().as_dict()
    data["sensors"].pop("hall_pulses_per_rev")
    return rig_from_dict(data, "test")


def test_a_rig_that_no_duty_drives_has_no_closed_loop() -> None:
    tool = reference("hard_joint")
    data = tool.as_dict() | {"input": {"kind": "voltage_v"}}
    other = rig_from_dict(data, "test")
    assert closed_loop(board_log("duty"), other, other, AssumedFirmware()) is None


# --- the trigger ---


def log_of(trigger: list[float], duty: list[float]) -> Log:
    columns = {"trigger": np.array(trigger), "duty": np.array(duty)}
    return Log(1e-3 * np.arange(1, len(trigger) + 1), columns, "log.csv")


def test_between_two_messages_the_trigger_rises_with_line_and_duty() -> None:
    log = log_of([0, 0.2, 0.2, 0.2, 0.2, 0.8, 0.8, 0.8], [0, 0, 0, 0, 0.5, 0.6, 0.7, 0.8])
    share, is_known = trigger_share(log)
    np.testing.assert_allclose(share, [0, 0.2, 0.5, 0.6, 0.7, 0.8, 0.8, 0.8])
    assert is_known.all()


def test_where_the_duty_falls_with_it_the_trigger_is_not_known() -> None:
    log = log_of([0.8] * 6 + [0.0] * 2, [0.5, 0.6, 0.6, 0.6, 0.6, 0.4, 0.3, 0.0])
    share, is_known = trigger_share(log)
    np.testing.assert_allclose(share, [0.8, 0.8, 0.8, 0.4, 0.3, 0.0, 0.0, 0.0])
    assert is_known.tolist() == [True] * 3 + [False] * 3 + [True] * 2


@pytest.mark.parametrize(
    ("duty", "row"),
    [([0.1, 0.5, 0.5, 0.4, 0.2], 3), ([0.5, 0.4, 0.4, 0.6], 4), ([0.3, 0.3], 2), ([0.3, 0.2], 1)],
)
def test_a_fall_begins_after_the_last_row_at_the_top(duty: list[float], row: int) -> None:
    assert fall_begin(np.array(duty)) == row


def test_the_direction_is_that_of_the_next_duty() -> None:
    log = log_of([0.0] * 6, [0.0, 0.5, 0.0, 0.0, -0.5, 0.0])
    assert reversed_rows(log).tolist() == [0, 0, 1, 1, 1, 1]
    assert reversed_rows(log_of([0.0] * 3, [0.0] * 3)).tolist() == [0, 0, 0]


def test_the_profile_gives_the_counts_of_the_trigger() -> None:
    """Of a trigger of 0.5 the converter's counts lie in the middle of the parameters' range."""
    assumed = AssumedFirmware("duty", {"trigger_low_count": 120.0, "trigger_high_count": 880.0})
    profile = trigger_profile(log_of([0.0, 0.0, 0.5, 0.5, 0.5], [0.0] * 5), assumed, 1)
    travel = interpolate_points(profile.travel, np.array([1e-3, 2.5e-3]))
    assert travel.tolist() == pytest.approx([0.0, (500.0 / 1023.0 - 0.1) / 0.8])


# --- departures ---


def states(*rows: float) -> dict[str, np.ndarray]:
    return {"state": np.array(rows, float), "trigger": np.zeros(len(rows))}


def switched(row: int, length: int = 40, value: float = 1.0) -> dict[str, np.ndarray]:
    """A state that changes from 0 in a row."""
    return states(*[0.0] * row, *[value] * (length - row))


@pytest.mark.parametrize(
    ("row", "departs"), [(7, 7), (8, None), (19, None), (23, None), (24, 23), (40, 23)]
)
def test_a_change_departs_outside_the_spread_of_the_runs_by_its_width(
    row: int, departs: int | None
) -> None:
    """The runs change in the rows 13 to 18, each known to a row by the message before."""
    runs = [switched(r) | {"trigger": np.arange(40.0)} for r in (13, 15, 18)]
    log = switched(row) | {"trigger": np.arange(40.0)}
    found = state_departure("state", log, runs, 40)
    assert (found and found.row) == departs


def test_a_change_to_another_state_departs() -> None:
    runs = [switched(13), switched(14)]
    assert state_departure("state", switched(13, value=2.0), runs, 40).row == 13
    assert state_departure("state", switched(13), [*runs, switched(13, value=2.0)], 40) is None


def test_a_change_that_a_run_lacks_need_not_happen() -> None:
    never = states(*[0.0] * 40)
    assert state_departure("state", never, [switched(13), never], 40) is None
    assert state_departure("state", never, [switched(13), switched(14)], 40).row == 16


def test_a_change_is_known_to_the_rows_since_the_message_before() -> None:
    rows = states(0, 0, 0, 0, 0, 1, 1)
    rows["trigger"] = np.array([0, 0, 0.5, 0.5, 0.5, 0.5, 0.5])
    assert changes("state", rows) == [Change(3, 5, 1.0)]
    rows["state"][0] = np.nan
    assert changes("state", rows) == [Change(3, 5, 1.0)]


def test_the_spread_has_a_least_width() -> None:
    assert spread([Change(9, 9, 1.0)]) == (9 - STATE_WIDTH, 9 + STATE_WIDTH)
    assert spread([Change(9, 10, 1.0), Change(18, 20, 1.0)]) == (-1, 30)


@pytest.mark.parametrize(
    ("count", "offset", "departs"),
    [(ROWS_APART, 2.01, 5), (ROWS_APART - 1, 2.01, None), (ROWS_APART, 1.99, None)],
)
def test_a_measured_signal_departs_by_the_width_of_the_spread_for_some_rows(
    count: int, offset: float, departs: int | None
) -> None:
    """The runs are 10 to 12 A; the width is 2 A."""
    runs = [{"current_a": np.full(40, level)} for level in (10.0, 12.0)]
    log = {"current_a": np.full(40, 11.0)}
    log["current_a"][5 : 5 + count] = 12.0 + offset
    judged = np.ones(40, bool)
    found = measured_departure("current_a", log, runs, judged)
    assert (found and found.row) == departs
    judged[8] = False
    assert measured_departure("current_a", log, runs, judged) is None
