"""A run of the diagnosis' menu on a board: a guided run in lock-step with the native firmware,
trigger and switches moved as an operator moves them.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from vgroove import lockstep, telemetry
from vgroove.errors import VgrooveError
from vgroove.gap.next_run.menu import MENU, profile_from_verdict, profile_named
from vgroove.guided_run import TIMEOUT_S, GuidedRun, Phase
from vgroove.log import Log, log_from_session, log_from_stream
from vgroove.recorder import RUN_COMPLETE
from vgroove.rig import read_rig
from vgroove.run_legs import legs_of
from vgroove.scenario import make_plant, without_board_effects
from vgroove.sil import SilBoard

ROOT = Path(__file__).resolve().parents[2]
RIG = ROOT / "rigs" / "board_18v.toml"
PRESSED_S = 1.5
HELD = ((0.0, 0.0), (PRESSED_S, 0.0), (PRESSED_S + 0.02, 1.0))


class Line:
    """The host's end of a lock-step run: what `vgroove run --on PORT` does, without a port;
    `cut(time_s)` breaks its TX.
    """

    def __init__(
        self, profile: str, cut: Callable[[float], bool] = lambda _: False, first: bytes = b""
    ) -> None:
        self.session = telemetry.Session()
        self.run = GuidedRun(profile_named(profile), self.session)
        self._framer, self._out, self._cut = (
            telemetry.Framer(self.session.counters),
            bytearray(first),
            cut,
        )
        self.acked_s, self.instructions = 0.0, [""]

    def send(self, data: bytes) -> None:
        """From the board."""
        frames = self._framer.feed(data)
        self.acked_s = max(
            [self.acked_s, *(frame.time_ms / 1000 for frame in frames if frame.id == telemetry.ACK)]
        )
        kept = self.run.select(frames)
        self.session.feed([] if self.run.ended else kept)
        self._out += self.run.next_bytes()
        instruction = self.run.instruction()
        self.instructions += [instruction] if instruction not in self.instructions[-1:] else []

    def receive(self, time_s: float) -> bytes:
        """To the board."""
        sent, self._out = bytes(self._out), bytearray()
        return b"" if self._cut(time_s) else sent


def performed(line: Line, seconds: float = 8.0, travel: tuple = HELD, **stimuli: object) -> Log:
    """Log of everything that the native board sent while the run was performed; `travel` of the
    trigger over time, `stimuli`: other fields of lockstep.Profile.
    """
    tool = make_plant(without_board_effects(read_rig(RIG)), 1)
    profile = lockstep.Profile(travel=travel, **stimuli)
    return log_from_stream(
        lockstep.run(
            SilBoard(target=1), tool, profile, seconds, lockstep.LockstepOptions(line=line, seed=1)
        ),
        "board",
    )


def begin_s(line: Line) -> float:
    """When the run began, board time."""
    return line.session.first_ms / 1000


def driven(log: Log) -> np.ndarray:
    """Rows in which the bridge drives: neither open nor shorting the motor."""
    return (log["coast"] == 0.0) & (log["duty"] != 0.0)


def test_a_staircase_is_performed_and_recorded_from_its_beginning() -> None:
    line = Line("staircase")
    log = performed(line)
    assert line.run.ended == RUN_COMPLETE and line.run.remarks() == []
    begin, profile = begin_s(line), profile_named("staircase")
    assert (
        begin == pytest.approx(PRESSED_S + 1.0, abs=0.1)
        and not driven(log)[log.time_s <= begin].any()
    )
    for start, level in profile.points()[1:]:
        at = np.abs(log.time_s - (begin + start + 0.4)) < 0.01
        assert log["duty"][at] == pytest.approx(level, abs=0.005), (start, level)
    kept = log_from_session(line.session, "kept")
    assert kept.time_s[0] == pytest.approx(begin, abs=0.03) and kept.time_s[-1] == pytest.approx(
        begin + 4.5, abs=0.1
    )
    assert line.session.counters.lost == 0 and (kept["mode"] == 0).all()
    assert log["coast"][log.time_s > begin + 4.1].all(), "open 50 ms after the last frame"
    shown = [
        instruction.split(":")[0]
        for instruction in line.instructions
        if "it allows" not in instruction
    ]
    assert shown[-4:] == [
        "pull the trigger fully and hold it",
        "hold the trigger, the run begins",
        "staircase",
        "release the trigger",
    ]


def test_the_trigger_limits_the_run_and_the_log_has_the_driven_duty() -> None:
    line = Line("staircase")
    log = performed(line, travel=((0.0, 0.0), (PRESSED_S, 0.0), (PRESSED_S + 0.02, 0.5)))
    assert line.run.ended == RUN_COMPLETE and 0.4 < np.abs(log["duty"]).max() < 0.55
    assert (
        "the trigger limited the run: at one time it allowed a duty of only 5"
        in line.run.remarks()[0]
    )


@pytest.mark.parametrize("released_in_ms", [0, 30, 80])
@pytest.mark.parametrize("offset_ms", range(0, 40, 6))
def test_a_released_trigger_ends_the_run_and_is_not_told_as_its_limit(
    offset_ms: int, released_in_ms: int
) -> None:
    line, at = Line("staircase"), PRESSED_S + 2.5 + offset_ms / 1000
    performed(line, travel=(*HELD, (at, 1.0), (at + released_in_ms / 1000, 0.0)))
    assert "the trigger was released" in line.run.ended
    assert not any("the trigger limited the run" in remark for remark in line.run.remarks())


def test_a_reversal_is_two_legs_with_the_switch_moved_by_the_operator_in_between() -> None:
    line = Line("reversal")
    travel = (*HELD, (6.0, 1.0), (6.02, 0.0), (8.0, 0.0), (8.02, 1.0))
    log = performed(line, 13.0, travel, reverse=((0.0, 0.0), (7.0, 1.0)))
    assert line.run.ended == RUN_COMPLETE
    assert [leg.reverse for leg in line.run.legs] == [
        False,
        True,
    ] and line.run.total_s == pytest.approx(4.2, abs=0.1)
    duty = log["duty"]
    assert duty[log.time_s < 7.0].min() == 0.0 and duty[log.time_s > 7.0].max() == 0.0
    assert (duty.min(), duty.max()) == (-1.0, 1.0)
    assert (
        "set the direction switch to backward" in line.instructions
        and len(log_from_session(line.session, "kept")) > 8000
    )


def test_a_coast_down_opens_the_bridge_where_its_level_is_0() -> None:
    line = Line("coast-down")
    log = performed(line)
    begin = begin_s(line)
    spans = ((0.0, 0.15), (0.3, 1.1), (1.25, 2.0), (3.2, 3.9))
    opened = [
        log["coast"][(log.time_s > begin + a) & (log.time_s < begin + b)].mean() for a, b in spans
    ]
    assert opened == [0.0, 0.0, 1.0, 1.0] and line.run.ended == RUN_COMPLETE


@pytest.mark.parametrize("profile", [profile.name for profile in MENU])
def test_every_run_of_the_menu_is_performed_without_a_fault(profile: str) -> None:
    line = Line(profile)
    both = profile == "reversal"
    log = performed(
        line,
        13.0 if both else 8.0,
        (*HELD, (6.0, 1.0), (6.02, 0.0), (8.0, 0.0), (8.02, 1.0)) if both else HELD,
        reverse=((0.0, 0.0), (7.0, 1.0)) if both else ((0.0, 0.0),),
    )
    assert line.run.ended == RUN_COMPLETE and 5 not in log["state"][log.time_s < begin_s(line)]
    assert (3 != log["state"]).all() and np.abs(log["current_a"]).max() < 50.0
    assert ("load_nm" in " ".join(line.run.remarks())) == (profile == "load steps")


def test_a_released_trigger_ends_the_run() -> None:
    line = Line("hold at heat")
    log = performed(
        line, travel=(*HELD, (4.0, 1.0), (4.02, 0.0), (5.0, 0.0), (5.02, 1.0), (6.0, 1.0))
    )
    assert line.run.ended.startswith("the trigger was released, 1.") and line.run.ended.endswith(
        "s into the run of 4.0 s"
    )
    assert not driven(log)[(log.time_s > 4.03) & (log.time_s < 5.0)].any()
    assert driven(log)[log.time_s > 5.3].all(), "the trigger drives without the host"


def test_a_line_that_breaks_stops_the_motor_within_50_ms() -> None:
    line = Line("hold at heat", cut=lambda time_s: time_s > 4.0)
    log = performed(line)
    assert line.run.ended.startswith(
        "frames were lost on the line: the board received none for 50 ms and ended the drive, 1."
    )
    last_s = log.time_s[driven(log)].max()
    assert (
        4.0 < line.acked_s < 4.02
        and 0.04 < last_s - line.acked_s <= 0.051
        and log["coast"][log.time_s > last_s].all()
    )


def test_a_line_without_tx_is_reported_before_anything_turns() -> None:
    line = Line("staircase", cut=lambda time_s: time_s > 1.0)
    log = performed(line, 4.0)
    assert "has answered no command" in line.run.ended
    assert driven(log)[log.time_s > 2.0].any(), "the trigger drives when the host is silent"


def test_a_trigger_that_is_held_already_is_to_be_released_first() -> None:
    line = Line("staircase")
    performed(line, 3.0, ((0.0, 0.0), (0.1, 0.0), (0.12, 0.6)))
    assert (
        line.run.phase is Phase.PREPARE
        and line.run.sent == 0
        and line.instructions[-1] == "release the trigger"
    )


def test_a_trigger_that_is_not_pulled_ends_the_run_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert TIMEOUT_S >= 60.0
    monkeypatch.setattr("vgroove.guided_run.TIMEOUT_S", 1.5)
    line = Line("staircase")
    log = performed(line, 3.0, ((0.0, 0.0),))
    assert line.run.ended == "not done within 1.5 s: hold the trigger" and not driven(log).any()


def test_a_mode_that_the_host_has_chosen_is_changed_and_one_of_the_switch_is_not() -> None:
    sync = telemetry.frame_bytes(
        telemetry.frame_of_signals("SET_MODE", 1, mode_request=1, mode_sequence=9)
    )
    line = Line("staircase", first=sync)
    performed(line, travel=((0.0, 0.0), (3.0, 0.0), (3.02, 1.0)), seconds=9.0)
    assert (
        line.run.ended == RUN_COMPLETE and "the board stays in mode duty" in line.run.remarks()[-1]
    )
    switched = Line("staircase")
    performed(switched, 4.0, mode=1)
    assert (
        switched.run.phase is Phase.PREPARE
        and "turn the mode switch to position 0" in switched.instructions
    )


def test_a_leg_never_changes_faster_than_the_boards_ramp() -> None:
    for profile in MENU:
        for leg in legs_of(profile):
            duty = leg.slewed(6.0)
            closed = ~leg.opens[1:] & ~leg.opens[:-1]
            assert np.abs(np.diff(duty))[closed].max() <= 6.0 * 0.02 + 1e-12 and duty.max() <= 1.0


@pytest.mark.parametrize(
    ("verdict", "words"),
    [
        ({"verdict": "effect", "next_experiment": None}, "asks for no further run"),
        ({"next_experiment": {"profile": "waltz"}}, "no run waltz; the menu has staircase"),
        (
            {"next_experiment": {"profile": "staircase", "points": [[0.0, 0.0], [1.0, 1.5]]}},
            "lie in -1..1",
        ),
        (
            {
                "next_experiment": {
                    "profile": "staircase",
                    "points": [[0.0, 0.0], [1.0, float("nan")]],
                }
            },
            "pairs .* of finite numbers",
        ),
        (
            {"next_experiment": {"profile": "staircase", "points": [[0.0, 0.0], [0.0, 0.5]]}},
            "go on in time",
        ),
        (
            {"next_experiment": {"profile": "staircase", "points": [[0.0, 0.0], [9.0, 0.5]]}},
            "to 4 s at most",
        ),
        ({"next_experiment": {"profile": "staircase", "points": "none"}}, "are pairs"),
    ],
)
def test_a_verdict_without_a_run_gives_a_message(verdict: dict, words: str) -> None:
    with pytest.raises(VgrooveError, match=words):
        profile_from_verdict(verdict, "v.json")


def test_the_run_of_a_verdict_is_that_of_the_menu_at_its_points() -> None:
    for profile in MENU:
        assert (
            profile_from_verdict(
                {"next_experiment": {"profile": profile.name, "points": profile.points()}}, "v.json"
            )
            == profile
        )
    other = profile_from_verdict(
        {
            "next_experiment": {
                "profile": "coast-down",
                "points": [[0.0, 0.0], [0.2, 0.4], [2.0, 0.0]],
            }
        },
        "v.json",
    )
    assert other.level == (0.0, 0.4, 0.0) and other.bridge_open(
        np.array([0.1, 0.3, 3.0])
    ).tolist() == [
        False,
        False,
        True,
    ]
