"""Faults injected into runs of every controller on the simulated AVR: the drive ends within the
time that docs/faults.md states, the fault is named, and the bridge stays open until the release.
"""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import fault_table
import numpy as np
import pytest

from vgroove import telemetry
from vgroove.board import BYTES_MAX, BoardInputs, pack_inputs
from vgroove.errors import VgrooveError
from vgroove.faults import FAULTS, INPUTS, OUTPUTS, FaultyBoard, parse_injection
from vgroove.log import read_log

ROOT = Path(__file__).resolve().parents[2]
VGROOVE = [sys.executable, "-m", "vgroove.cli"]
STALL_MS = 500.0  # default of stall_ms
AFTER_RELEASE_MS = 60.0  # 50 ms of the trigger's travel and the debouncing
# Fault -> latest end of the drive in ms after it (None: it goes on until the release), what the
# telemetry must name.
LIMITS: dict[str, tuple[float | None, str]] = {
    "hall_open": (STALL_MS + 20.0, "sensor_lost"),
    "hall_short": (STALL_MS + 20.0, "sensor_lost"),
    "bus_dip": (15.0, "under_voltage"),
    "brown_out": (0.2, "brown-out"),
    "eeprom_brown_out": (0.0, "brown-out"),
    "watchdog": (20.0, "watchdog"),
    "trigger_stuck": (0.0, ""),
    "bridge_fault": (3 * STALL_MS, "sensor_lost"),  # after the shaft has run down
    "pot_open": (None, "sensor_lost"),
    "contact_bounce": (None, ""),
    "line_errors": (None, ""),
    "current_stuck": (None, "sensor_lost"),
    "current_offset": (250.0, "sensor_lost"),
    "adc_reference": (250.0, "sensor_lost"),
}
# Found at 3000 rpm or more (firmware/app/balance.h): the approach in mode torque is slower.
FOUND_AT_SPEED = {"current_offset", "adc_reference"}
SLOW_MODE = "torque"


@pytest.mark.parametrize("name", FAULTS)
def test_the_drive_ends_in_time_and_the_fault_is_named(name: str) -> None:
    for mode, mode_name in enumerate(fault_table.MODES):
        limit_ms, named = LIMITS[name]
        if name in FOUND_AT_SPEED and mode_name == SLOW_MODE:
            limit_ms = None
        found = fault_table.outcome(name, mode, 0)
        assert not named or found.ended_before or named in found.named, found
        if found.opened_ms is None:
            assert limit_ms is None, found
            assert found.after_release_ms < AFTER_RELEASE_MS, found
        elif limit_ms is not None:
            assert found.opened_ms <= limit_ms, found


def test_without_a_fault_the_drive_goes_on_until_the_release() -> None:
    found = fault_table.outcome("line_errors", 0, 1)
    assert found.opened_ms is None and found.drove and found.named == ()


def test_the_page_has_a_row_for_every_fault() -> None:
    text = fault_table.PAGE.read_text("utf-8")
    assert set(LIMITS) == set(FAULTS)
    for name, fault in FAULTS.items():
        assert f"| `{name}` | {fault.text} |" in text


@pytest.mark.proof
def test_the_page_is_what_the_runs_give() -> None:
    command = [sys.executable, str(ROOT / "tests/avr/fault_table.py"), "--check"]
    assert subprocess.run(command, check=False).returncode == 0


class Recorded:
    """A board that keeps its inputs and drives. It takes at most `taken()` periods of a request, as
    a board does that changes the bridge's command.
    """

    def __init__(self, taken: Callable[[], int | None] = lambda: None) -> None:
        self.inputs: list[BoardInputs] = []
        self._taken = taken

    def periods(self, messages: bytes) -> bytes:
        """Keep the inputs."""
        given = np.frombuffer(messages, INPUTS)[: self._taken()]
        for row in given:
            counts, edges = row["adc_counts"].tolist(), row["edge_cycle"][: row["edge_count"]]
            rx = row["rx"][: row["rx_count"]].tobytes()
            self.inputs.append(
                BoardInputs(tuple(counts), tuple(edges.tolist()), int(row["switches"]), rx)
            )
        outputs = np.zeros(len(given), OUTPUTS)
        outputs["compare"], outputs["dead_counts"], outputs["tx_count"] = 100, 16, BYTES_MAX
        return outputs.tobytes()


def faulty(name: str, periods: int = 3000, edges: tuple[int, ...] = ()) -> tuple[Recorded, list]:
    """Inputs and outputs of a board whose fault begins in period 1000."""
    board, out = Recorded(), []
    at_s = 1000 * 510 / 16e6
    changed = FaultyBoard(board, parse_injection(f"{name}@{at_s!r}"))
    for k in range(periods):
        given = BoardInputs((512 + k % 7, 720, 500, 154), edges if k < 1000 else (5,), 1, b"")
        out.append(changed.period(given))
    return board, out


@pytest.mark.parametrize(
    ("name", "edges", "first"),
    [
        ("hall_open", (), ()),  # an even number of edges: the line is high
        ("hall_open", (3,), ()),
        ("hall_short", (), (0,)),
        ("hall_short", (3,), (0,)),
    ],
)
def test_a_broken_hall_line_changes_once_and_is_then_silent(
    name: str, edges: tuple[int, ...], first: tuple[int, ...]
) -> None:
    board, _ = faulty(name, edges=edges)
    assert board.inputs[999].edges == edges
    assert board.inputs[1000].edges == first
    assert all(given.edges == () for given in board.inputs[1001:])


def test_an_odd_number_of_edges_leaves_the_line_low() -> None:
    board = Recorded()
    changed = FaultyBoard(board, parse_injection("hall_open@0.001"))
    for k in range(100):
        changed.period(BoardInputs((512, 720, 500, 154), (7,) if k == 3 else ()))
    assert [given.edges for given in board.inputs if given.edges] == [(7,), (0,)]


@pytest.mark.parametrize(
    ("name", "place", "values"),
    [
        ("current_stuck", 0, {512 + 999 % 7}),
        ("current_offset", 0, {576 + k for k in range(7)}),
        ("adc_reference", 1, {792}),
        ("pot_open", 2, {1023}),
        ("trigger_stuck", 2, {920}),
    ],
)
def test_counts_of_a_fault(name: str, place: int, values: set[int]) -> None:
    board, _ = faulty(name)
    assert {given.adc_counts[place] for given in board.inputs[1000:]} == values
    assert board.inputs[999].adc_counts == (512 + 999 % 7, 720, 500, 154)


def test_a_bus_dip_and_a_bounce_end() -> None:
    dip = [given.adc_counts[1] for given in faulty("bus_dip")[0].inputs]
    assert dip[999] == 720 and dip[1000] == 240 and dip[1620] == 240 and dip[1640] == 720
    bounce = [given.switches for given in faulty("contact_bounce")[0].inputs]
    assert (
        set(bounce[:1000]) == {1} and set(bounce[1000:1620]) == {0, 1} and set(bounce[1640:]) == {1}
    )


def test_bit_errors_have_their_rate() -> None:
    _, out = faulty("line_errors", periods=21_000)
    assert all(not any(o.tx) for o in out[:1000])
    bits = sum(byte.bit_count() for o in out[1000:] for byte in o.tx)
    assert bits == pytest.approx(20_000 * BYTES_MAX * 8 * 1e-3, rel=0.15)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_the_same_however_many_periods_are_asked_for(name: str) -> None:
    rng = np.random.default_rng(list(FAULTS).index(name))
    given = [
        BoardInputs(tuple(rng.integers(1024, size=4).tolist()), (7,) * int(rng.integers(3)), 1, rx)
        for rx in (bytes([n % 256]) * (n % 3) for n in range(2000))
    ]
    singly, in_stretches = Recorded(), Recorded(lambda: int(rng.integers(1, 33)))
    fault = parse_injection(f"{name}@0.0111")
    one, several = FaultyBoard(singly, fault), FaultyBoard(in_stretches, fault)
    out = [one.periods(pack_inputs(inputs)) for inputs in given]
    answers = b""
    while len(several.commands) < len(given):
        ahead = given[len(several.commands) :][:32]
        answers += several.periods(b"".join(map(pack_inputs, ahead)))
    assert in_stretches.inputs == singly.inputs and several.commands == one.commands
    assert answers == b"".join(out)


def test_a_bridge_that_is_off_does_not_hide_the_command() -> None:
    board = Recorded()
    changed = FaultyBoard(board, parse_injection("bridge_fault@0"))
    assert changed.period(BoardInputs((512, 720, 500, 154))).coast
    assert changed.commands == [100]


@pytest.mark.parametrize("text", ["hall@0.5", "hall_open", "hall_open@x", "hall_open@-1"])
def test_an_unusable_fault_is_named(text: str) -> None:
    with pytest.raises(VgrooveError, match="--fault"):
        parse_injection(text)


def test_the_command_injects_a_fault(tmp_path: Path) -> None:
    scenario = ROOT / "scenarios/spin_up.toml"
    log = tmp_path / "run.csv"
    command = [*VGROOVE, "run", str(scenario), "-o", str(log), "--fault", "hall_open@1.0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    rows = read_log(log)
    assert rows["coast"][rows.time_s < 0.98][-100:].max() == 0
    assert rows["coast"][rows.time_s > 1.6].min() == 1
    fault = next(v for v, n in telemetry.value_table("STATE", "state").items() if n == "fault")
    assert fault in set(rows["state"])
    refused = subprocess.run(
        [*command[:-1], "watchdog@1.0"], capture_output=True, text=True, timeout=300, check=False
    )
    assert refused.returncode == 2 and "add --on avr" in refused.stderr
