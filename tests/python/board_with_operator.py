"""A simulated board on a pty with a simulated operator at its trigger:
`python board_with_operator.py avr|sil LOG RUN_S HELD_S TRAVEL`.

The operator pulls the trigger to TRAVEL when the host commands a profile and holds it for HELD_S;
RUN_S after the pull the run ends, and LOG is written. The simulation is at most as fast as real
time, and while the host sends commands it waits for each, so that no frame is late on a busy
machine. The name of the port goes to stdout.
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
from vgroove.run import RunLog, RunOptions, make_board
from vgroove.scenario import make_plant, without_board_effects

REACTION_S = 0.6
MAX_RUN_S = 90.0
# Wall time after which a host without commands is taken to have stopped sending; less than the time
# for which the host itself accepts silence of the board.
HOST_TIMEOUT_S = 1.5
COMMAND_MARGIN_S = 0.004  # by which a command may be later than its period


class HostAndOperator:
    """The board's UART, connected to the host's pty, as a line of `vgroove.lockstep`, and the
    travel of the trigger.
    """

    def __init__(self, pty: PtyLine, held_s: float, travel: float) -> None:
        self._pty, self._held_s, self._pulled_to, self._bytes = pty, held_s, travel, bytearray()
        self.travel = [(0.0, 0.0)]
        self.pulled_s = float("inf")
        self._commanded_s: float | None = None
        self._began = time.monotonic()

    def send(self, data: bytes) -> None:
        """Bytes of the board, to the host."""
        self._pty.send(data)

    def receive(self, time_s: float) -> bytes:
        """Bytes of the host, once it has sent the command that is due."""
        got = self._take(time_s)
        time.sleep(max(0.0, time_s - (time.monotonic() - self._began)))
        deadline = time.monotonic() + HOST_TIMEOUT_S
        while (
            self._commanded_s is not None
            and time_s - self._commanded_s > PERIOD_S + COMMAND_MARGIN_S
            and self._pty.has_reader()
        ):
            if time.monotonic() > deadline:
                self._commanded_s = None
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
                self._commanded_s = time_ms / 1000
                self._pull(time_s)
        return got

    def _pull(self, time_s: float) -> None:
        if self.pulled_s == float("inf"):
            self.pulled_s = time_s + REACTION_S
            ends_s = self.pulled_s + self._held_s
            self.travel += [
                (self.pulled_s, 0.0),
                (self.pulled_s, self._pulled_to),
                (ends_s, self._pulled_to),
                (ends_s, 0.0),
            ]


def main(on: str, log: Path, run_s: float, held_s: float, travel: float) -> None:
    """Run the board until `run_s` after the pull and write its log."""
    tool = make_plant(without_board_effects(read_rig(ROOT / "rigs" / "board_18v.toml")), 1)
    sent = bytearray()
    with (
        PtyLine() as pty,
        make_board(RunOptions(on, elf=elf() if on == "avr" else None), 1) as board,
    ):
        sys.stdout.write(pty.name + "\n")
        sys.stdout.flush()
        pty.wait_for_reader()
        line = HostAndOperator(pty, held_s, travel)
        for progress in lockstep.steps(
            board,
            tool,
            lockstep.Profile(travel=line.travel),
            MAX_RUN_S,
            lockstep.LockstepOptions(line=line),
        ):
            sent = progress.sent
            if progress.time_s > line.pulled_s + run_s:
                break
        pty.drain()
    run_log = RunLog(log)
    run_log.add(bytes(sent))
    run_log.close()


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]), *map(float, sys.argv[3:]))
