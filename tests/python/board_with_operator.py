"""A board on a pty with a hand at its trigger that waits for the host: `python patient_board.py
avr|sil LOG RUN_S HELD_S TRAVEL`.

The hand pulls the trigger to TRAVEL when the host commands a profile and holds it for HELD_S; RUN_S
after the pull the run ends, and LOG is written. Time is real at most, and while the host commands
it goes no further than the host has answered: a busy machine loses no frames. The port's name goes
to stdout.
"""

import struct
import sys
import time
from pathlib import Path

from test_run import ROOT, elf
from vgroove import lockstep, telemetry
from vgroove.profile_sender import PERIOD_S
from vgroove.pty_line import PtyLine
from vgroove.rig import read_rig
from vgroove.run import RunOptions, make_board, write_run
from vgroove.scenario import make_plant, without_board_effects

REACTION_S = 0.6
LONGEST_S = 90.0
GONE_S = 1.5  # of the clock: a host that commands no longer; less than the silence that it bears


class HostAndHand:
    """The host's end of the UART and the trigger, as a line of `vgroove.lockstep`."""

    def __init__(self, pty: PtyLine, held_s: float, pull: float) -> None:
        self._pty, self._held_s, self._pull_to, self._bytes = pty, held_s, pull, bytearray()
        self.travel = [(0.0, 0.0)]
        self.pulled_s = float("inf")
        self._heard_s: float | None = None
        self._began = time.monotonic()

    def send(self, data: bytes) -> None:
        """To the host."""
        self._pty.send(data)

    def receive(self, time_s: float) -> bytes:
        """From the host, when it is up to date."""
        got = self._take(time_s)
        time.sleep(max(0.0, time_s - (time.monotonic() - self._began)))
        deadline = time.monotonic() + GONE_S
        while (
            self._heard_s is not None
            and time_s - self._heard_s > PERIOD_S + 0.004
            and self._pty.has_reader()
        ):
            if time.monotonic() > deadline:
                self._heard_s = None
                break
            time.sleep(0.0005)
            got += self._take(time_s)
        return got

    def _take(self, time_s: float) -> bytes:
        got = self._pty.receive()
        self._bytes += got
        while len(self._bytes) >= telemetry.FRAME_BYTES:
            _, time_ms, _, frame_id = struct.unpack_from("<BIBI", self._bytes)
            del self._bytes[: telemetry.FRAME_BYTES]
            if frame_id == telemetry.PROFILE:
                self._heard_s = time_ms / 1000
                self._pull(time_s)
        return got

    def _pull(self, time_s: float) -> None:
        if self.pulled_s == float("inf"):
            self.pulled_s = time_s + REACTION_S
            ends_s = self.pulled_s + self._held_s
            self.travel += [
                (self.pulled_s, 0.0),
                (self.pulled_s, self._pull_to),
                (ends_s, self._pull_to),
                (ends_s, 0.0),
            ]


def main(on: str, log: Path, run_s: float, held_s: float, pull: float) -> None:
    tool, sent = (
        make_plant(without_board_effects(read_rig(ROOT / "rigs" / "board_18v.toml")), 1),
        bytearray(),
    )
    with (
        PtyLine() as pty,
        make_board(RunOptions(on, elf=elf() if on == "avr" else None), 1) as board,
    ):
        sys.stdout.write(pty.name + "\n")
        sys.stdout.flush()
        pty.wait_for_reader()
        line = HostAndHand(pty, held_s, pull)
        for progress in lockstep.steps(
            board, tool, lockstep.Profile(travel=line.travel), LONGEST_S, line=line
        ):
            sent = progress.sent
            if progress.time_s > line.pulled_s + run_s:
                break
        pty.drain()
    write_run(bytes(sent), log)


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), *map(float, sys.argv[3:]))
