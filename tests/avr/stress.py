"""Tapes that search for the longest tick: presses and releases while the shaft turns, fold-back,
abrupt speeds, and commands up to the rate of the line.

`stress.py COUNT FIRST_SEED [BUILD ...]` replays COUNT random tapes of each mode on the simulated
AVR and prints those with the longest ticks, as the rows of stress_corpus.json with build and
cycles.
"""

import json
import sys
import tempfile
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from builds import BUILDS
from command_load import BYTE_PERIODS
from equality import sent_bytes
from unequal_pitches import PERIODS_PER_SECOND, command

from vgroove import board, telemetry
from vgroove.board import CYCLES_PER_PERIOD, BoardInputs, pack_inputs, read_statistics
from vgroove.eeprom_image import eeprom_image, mode_number

ROOT = Path(__file__).resolve().parents[2]
CORPUS = Path(__file__).with_name("stress_corpus.json")
KEPT = 2  # tapes of each mode and build in the corpus
CONTACT = 1
DURATION_S = 1.6
CALIBRATED_S = 0.3
PITCHES_S = (4e-3, 2e-3, 1.2e-3, 1e-3, 0.95e-3)  # to 15,800 rpm
PRESSED_S, OPEN_S = (0.02, 0.3), (0.004, 0.08)
FOLDBACK_A = 20.0
# ADC counts of the current: rest, drive, above the fold-back limit, braking, braking above it.
CURRENTS = (512, 600, 660, 700, 800, 880, 420, 300, 160)
SUPPLIES = (640, 700, 740, 800, 820)
LINES = ("quiet", "commands", "line rate")
MODES = ("duty", "sync", "screwing", "vibration", "torque", "drill")
# Gaps between two bursts of commands; a host that waits for its ACKs is paced.
GAPS_S = {"line rate": (0.0, 0.0), "commands": (0.0, 0.06), "paced": (0.06, 0.1)}
BURST = 3  # most commands without a gap: what the board's receive queue holds
FIRST_TOP, RECEIVE_CYCLE, TICK = 255, 128, 16000  # docs/firmware.md, Timing
TICK_CLEAR = 600  # cycles after a tick in which the end of a byte depends on the target


@dataclass(frozen=True)
class Stress:
    """A random tape: mode at start, other parameters in physical units, load of the serial line."""

    mode: str
    seed: int
    line: str = "commands"
    params: dict[str, float] = field(default_factory=dict)

    def eeprom(self) -> bytes:
        """EEPROM that starts the board in the mode with the parameters."""
        return eeprom_image({"mode": mode_number(self.mode), **self.params})


def random_stress(mode: str, seed: int) -> Stress:
    """The tape of a seed: with and without fold-back and run-down, each load of the line."""
    rng = np.random.default_rng([seed, 1])
    params: dict[str, float] = {}
    if rng.random() < 0.6:
        params["foldback_a"] = FOLDBACK_A
    if rng.random() < 0.4:
        params["release_mode"] = 1
    return Stress(mode, seed, str(rng.choice(LINES, p=(0.2, 0.5, 0.3))), params)


def some_command(rng: np.random.Generator, sequence: int) -> bytes:
    """Any command that leaves mode and drive as they are."""
    kind = int(rng.integers(0, 5))
    if kind == 0:
        return command("PARAM_READ", read_index=sequence % 40, read_sequence=sequence)
    if kind == 1:
        signals = {"setpoint_which": 0, "setpoint_value": 32767 - int(rng.integers(0, 4000))}
        return command("SETPOINT", **signals, setpoint_sequence=sequence)
    if kind == 2:
        return command("PARAM_WRITE", write_index=9, write_value=6400, write_sequence=sequence)
    if kind == 3:
        return command("DUMP", dump_sequence=sequence)
    damaged = bytearray(command("PARAM_READ", read_index=3, read_sequence=sequence))
    damaged[int(rng.integers(1, len(damaged)))] ^= 1 << int(rng.integers(0, 8))
    return bytes(damaged)


def clear_of_tick(at: float) -> float:
    """The first period from `at` on in which a received byte ends clear of the tick."""
    while (FIRST_TOP + int(at) * CYCLES_PER_PERIOD + RECEIVE_CYCLE) % TICK < TICK_CLEAR:
        at += 1.0
    return at


def received_bytes(stress: Stress, rng: np.random.Generator) -> dict[int, bytes]:
    """Period -> bytes whose reception ends in it."""
    found: dict[int, bytes] = {}
    at, sequence = CALIBRATED_S * PERIODS_PER_SECOND, 0
    while stress.line != "quiet" and at < (DURATION_S - 0.05) * PERIODS_PER_SECOND:
        for _ in range(int(rng.integers(1, BURST + 1))):
            for byte in some_command(rng, sequence % 256):
                at = at if stress.line == "line rate" else clear_of_tick(at)
                found[int(at)] = found.get(int(at), b"") + bytes([byte])
                at += BYTE_PERIODS
            sequence += 1
        if stress.line != "line rate":
            at += rng.uniform(*GAPS_S[stress.line]) * PERIODS_PER_SECOND
    return found


class Shaft:
    """Hall edges at a pitch that changes abruptly; some are missed, some doubled."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng, self._next, self.pitch_s = rng, 0.0, 1e-3

    def edges(self, begin: int) -> list[int]:
        """Cycles of the edges in the PWM period that begins at cycle `begin`."""
        self._next = min(max(self._next, begin), begin + 16e6 * self.pitch_s)
        found: list[int] = []
        while self._next < begin + CYCLES_PER_PERIOD:
            kind = self._rng.integers(0, 100)
            found += [] if kind == 0 else [int(self._next) - begin]
            self._next += 450 if kind == 1 else 16e6 * self.pitch_s
        return found


@dataclass
class _Hand:
    """Trigger, current and supply of the present stretch of the tape, in ADC counts."""

    pressed: bool = False
    travel: int = 900
    until: float = CALIBRATED_S
    current: int = 512
    supply: int = 740

    def press(self, time_s: float, rng: np.random.Generator) -> None:
        """Presses or releases the trigger when the stretch is over."""
        if time_s < self.until:
            return
        self.pressed = not self.pressed
        self.travel = int(rng.integers(300, 1000))
        self.until = time_s + rng.uniform(*(PRESSED_S if self.pressed else OPEN_S))

    def inputs(self, edges: list[int], rx: bytes, rng: np.random.Generator) -> BoardInputs:
        """The board's inputs of a PWM period."""
        current = self.current + int(rng.integers(-6, 7))
        travel = self.travel + int(rng.integers(-3, 4)) if self.pressed else 100
        counts = (current, self.supply, min(travel, 1000), 154)
        return BoardInputs(counts, edges, CONTACT if self.pressed else 0, rx)


def stress_tape(stress: Stress) -> bytes:
    """Packed board inputs, one per PWM period. Switches change only between two ticks, since no
    hardware latches them.
    """
    rng = np.random.default_rng([stress.seed, 2])
    received, shaft, hand, inputs = received_bytes(stress, rng), Shaft(rng), _Hand(), []
    for k in range(int(DURATION_S * PERIODS_PER_SECOND)):
        in_tick = k % (16000 / CYCLES_PER_PERIOD)
        if 8 < in_tick <= 9:
            hand.press(k / PERIODS_PER_SECOND, rng)
        if k % 63 == 0 and rng.random() < 0.3 and k > CALIBRATED_S * PERIODS_PER_SECOND:
            hand.current, hand.supply = int(rng.choice(CURRENTS)), int(rng.choice(SUPPLIES))
        if k % 313 == 0:
            shaft.pitch_s = float(rng.choice(PITCHES_S))
        turns = k > (CALIBRATED_S + 0.02) * PERIODS_PER_SECOND
        edges = shaft.edges(k * CYCLES_PER_PERIOD) if turns else []
        inputs.append(pack_inputs(hand.inputs(edges, received.get(k, b""), rng)))
    return b"".join(inputs)


def statistics(stress: Stress, elf: Path, mcu: str) -> tuple[dict, bytes]:
    """Statistics and output of the tape on the simulated AVR."""
    with tempfile.TemporaryDirectory() as folder:
        stats, memory = Path(folder) / "stats.json", Path(folder) / "eeprom.bin"
        memory.write_bytes(stress.eeprom())
        out = board.replay(elf, stress_tape(stress), mcu=mcu, stats=stats, eeprom=memory)
        return read_statistics(stats), out


def acknowledged(out: bytes) -> int:
    """Number of ACK frames in the outputs of a board."""
    frames = telemetry.Framer().feed(sent_bytes(out))
    return sum(frame.id == telemetry.ACK for frame in frames)


def corpus() -> list[tuple[str, Stress]]:
    """(build, tape) of each tape of the corpus with each build that has its mode."""
    rows = json.loads(CORPUS.read_text(encoding="utf-8"))
    tapes = [Stress(**row) for row in rows]
    return [(name, tape) for tape in tapes for name in BUILDS if BUILDS[name].has(tape.mode)]


def longest(mode: str, seeds: range, name: str) -> list[dict]:
    """The KEPT tapes of a mode with the longest ticks on a build, and these ticks."""
    build, rows = BUILDS[name], []
    for seed in seeds:
        stress = random_stress(mode, seed)
        elf = ROOT / "build" / build.folder / "vgroove.elf"
        tick = statistics(stress, elf, build.mcu)[0]["tick"]["worst_cycles"]
        rows.append({**asdict(stress), "build": name, "found_cycles": tick})
    return sorted(rows, key=lambda row: -row["found_cycles"])[:KEPT]


def main() -> None:
    """Print the rows of the longest ticks."""
    count, first = int(sys.argv[1]), int(sys.argv[2])
    rows = [
        row
        for name in sys.argv[3:] or BUILDS
        for mode in MODES
        if BUILDS[name].has(mode)
        for row in longest(mode, range(first, first + count), name)
    ]
    sys.stdout.write(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
