"""The lock-step loop in C++ sends the same bytes as the one in Python, and records the true values
of the tool.
"""

import threading
from pathlib import Path

import numpy as np
import pytest

from vgroove import _core, lockstep
from vgroove.rig import read_rig
from vgroove.scenario import make_plant
from vgroove.sil import SilBoard
from vgroove.telemetry import frame_bytes, frame_of_signals

RIGS = Path(__file__).resolve().parents[2] / "rigs"
FRONT = lockstep.FrontEnds(current_noise_a=0.3, supply_noise_v=0.05)
TRIGGER_TRAVEL = ((0.0, 0.0), (0.2, 0.0), (0.25, 1.0), (0.55, 1.0), (0.56, 0.0))
READ = frame_bytes(frame_of_signals("PARAM_READ", 100, read_index=3, read_sequence=1))
PROFILES = {
    "drill_driver_low": lockstep.Profile(travel=TRIGGER_TRAVEL, load_nm=((0.0, 0.0), (0.4, 4.0))),
    "impact_driver": lockstep.Profile(
        travel=TRIGGER_TRAVEL, reverse=((0.0, 0.0), (0.5, 1.0)), bounce_s=0.003
    ),
    "board_18v": lockstep.Profile(
        travel=TRIGGER_TRAVEL,
        load_nm=((0.0, 0.0), (0.4, 0.3)),
        hall_breaks=((0.3, 0.33),),
        current_add_a=((0.0, 0.0), (0.5, 70.0)),
    ),
}


class PythonLoopBoard(SilBoard):
    """The same firmware under a type for which lockstep.steps uses the loop in Python."""

    periods = None


class LookAheadBoard(SilBoard):
    """The same firmware, given messages that are computed ahead, as a board in another process."""


def run(board_type: type, rig: str, seed: int = 7) -> tuple[bytes, np.ndarray]:
    tool, truth = make_plant(read_rig(RIGS / f"{rig}.toml"), 1), _core.Truth(3)
    line = lockstep.Script([(0.1, READ), (0.3, READ * 3)])
    with board_type() as board:
        *_, last = lockstep.steps(
            board,
            tool,
            PROFILES[rig],
            0.6,
            lockstep.LockstepOptions(front=FRONT, line=line, seed=seed, truth=truth),
        )
    return bytes(last.sent), truth.rows


@pytest.mark.parametrize("rig", sorted(PROFILES))
def test_all_loops_send_the_same_bytes(rig: str) -> None:
    slow, slow_truth = run(PythonLoopBoard, rig)
    fast, fast_truth = run(SilBoard, rig)
    assert len(slow) > 5000 and fast == slow
    ahead, ahead_truth = run(LookAheadBoard, rig)
    assert ahead == slow and np.array_equal(ahead_truth, slow_truth, equal_nan=True)
    assert fast_truth.shape == (round(0.6 / lockstep.PERIOD_S) // 3, len(_core.TRUTH_COLUMNS))
    assert np.array_equal(fast_truth, slow_truth, equal_nan=True)
    assert run(SilBoard, rig, seed=8)[0] != fast


def test_truth_records_the_true_values_of_the_tool() -> None:
    rig = read_rig(RIGS / "impact_driver.toml")
    tool, truth = make_plant(rig, 1), _core.Truth(1)
    with SilBoard() as board:
        for _ in lockstep.steps(
            board, tool, PROFILES["impact_driver"], 0.5, lockstep.LockstepOptions(truth=truth)
        ):
            pass
    column = dict(zip(_core.TRUTH_COLUMNS, truth.rows.T, strict=True))
    assert np.allclose(np.diff(column["time_s"]), lockstep.PERIOD_S, rtol=1e-9)
    assert (column["speed_rad_s"][-1], column["hammer_mm"][-1], column["head_rad"][-1]) == (
        tool.speed_rad_s,
        tool.hammer_mm,
        tool.head_rad,
    )
    driven = column["time_s"] > 0.25
    assert np.isnan(column["duty"][~driven][:100]).all() and column["duty"][driven].max() == 1.0
    # the integrals of housing reaction and joint torque differ by the angular momentum of all that
    # turns, at most 0.35 N m s
    momentum = np.cumsum(column["housing_nm"]) * lockstep.PERIOD_S
    joint = np.cumsum(column["joint_nm"]) * lockstep.PERIOD_S
    assert momentum[-1] == pytest.approx(joint[-1], abs=0.35)


def test_pacer_gives_a_chunk_the_bytes_of_its_periods() -> None:
    one, many = lockstep.Pacer(), lockstep.Pacer()
    for data, periods in ((b"", 3), (b"abc", 2), (b"", 5), (b"defgh", 4), (b"", 9)):
        one.add(data)
        many.add(data)
        singly = [one.next() for _ in range(periods)]
        assert many.take(periods).tolist() == [byte[0] if byte else -1 for byte in singly]


def test_one_thread_at_a_time() -> None:
    """While a thread runs the firmware without the interpreter's lock another one is refused, and
    the next run gives the same bytes.
    """
    alone = run(SilBoard, "impact_driver")[0]
    refusals: list[str] = []
    over = threading.Event()

    def make_firmware_repeatedly() -> None:
        while not over.is_set():
            try:
                _core.Firmware()
            except RuntimeError as error:
                refusals.append(str(error))

    other = threading.Thread(target=make_firmware_repeatedly)
    other.start()
    for _ in range(100):
        refusals += refusals_of_a_run()
        if refusals:
            break
    over.set()
    other.join()
    assert refusals and "only one can run in a process" in refusals[0]
    assert run(SilBoard, "impact_driver")[0] == alone


def refusals_of_a_run() -> list[str]:
    """Run the firmware for about a second; the message of the refusal, if another thread was
    running it.
    """
    count = 30_000
    stimuli = lockstep.StimulusSource(PROFILES["impact_driver"], FRONT, 7).chunk(0, count)
    try:
        board, tool = SilBoard(), make_plant(read_rig(RIGS / "impact_driver.toml"), 1)
        _core.run_lockstep(
            board.machine,
            tool,
            _core.Stimuli(*stimuli.columns(), np.full(count, -1, np.int16), FRONT.scales()),
            (True, 0, 0),
        )
    except RuntimeError as error:
        return [str(error)]
    return []


@pytest.mark.parametrize("rig", ["board_18v", "impact_driver", "drill_driver_low"])
@pytest.mark.parametrize(
    "command",
    [(float("nan"), 0.0, 0.0), (1.5, 0.0, 0.0), (0.5, float("nan"), 0.0), (0.5, 0.0, np.inf)],
)
def test_a_period_takes_finite_commands_within_the_bridge(
    rig: str, command: tuple[float, float, float]
) -> None:
    tool = make_plant(read_rig(RIGS / f"{rig}.toml"), 1)
    with pytest.raises(ValueError, match="duty and dead must be within"):
        tool.period(False, *command)
    assert np.isfinite(tool.period(False, 0.5, 0.0)[0])


def test_a_front_end_refuses_what_is_no_number() -> None:
    for counts in (_core.current_counts, _core.bus_counts, _core.temperature_counts):
        with pytest.raises(ValueError, match="not nan"):
            counts(float("nan"))
        assert counts(1e9) == 1023 and counts(-1e9) == 0
