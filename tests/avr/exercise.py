"""A run of ten seconds that uses every driver: both directions, over-current, missed and double
edges, edges at ticks, contact bounce, EEPROM writes.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

from equality import TapeBoard

from vgroove import lockstep, telemetry
from vgroove.board import CYCLES_PER_PERIOD, BoardInputs, BoardOutputs
from vgroove.lockstep import FrontEnds, Profile, Tool
from vgroove.rig import read_rig
from vgroove.scenario import make_plant, without_board_effects
from vgroove.sil import SilBoard

RIG = Path(__file__).resolve().parents[2] / "rigs" / "board_18v.toml"
DURATION_S = 10.0
FIRST_TOP, TICK = 255, 16000  # CPU cycles: start of period 0, length of a tick
PROFILE = Profile(
    travel=(
        (0, 0),
        (0.3, 0),
        (0.5, 1),
        (1.4, 1),
        (1.45, 0),
        (2.0, 0),
        (2.1, 0.3),
        (2.9, 0.6),
        (3.4, 0.2),
        (3.6, 0),
        (4.7, 0),
        (4.8, 0.5),
        (5.6, 0.9),
        (5.9, 0.1),
        (6.0, 0),
        (7.0, 0),
        (7.1, 1),
        (7.6, 1),
        (7.7, 0),
        (8.2, 0),
        (8.3, 0.7),
        (9.4, 0.7),
        (9.5, 0),
    ),
    reverse=((0, 0), (4.2, 1), (6.6, 0)),
    current_add_a=(
        (0, 0),
        (5.2, 0),
        (5.2, 12),
        (5.25, 12),
        (5.25, 0),
        (7.4, 0),
        (7.4, 62),
        (7.403, 62),
        (7.403, 0),
    ),
    load_nm=((0, 0), (2.2, 0), (2.6, 0.6), (3.0, 0.2), (8.4, 0), (8.8, 1.0), (9.2, 0.2)),
    hall_breaks=((1.0, 1.004), (2.7, 2.702), (8.9, 9.15)),
    mode=0,
    bounce_s=0.003,
)


class DisturbedEdges:
    """A tool whose Hall edges are moved to a tick when they are near one; some are doubled, some
    missed.
    """

    def __init__(self, tool: Tool) -> None:
        self._tool = tool
        self._begin = FIRST_TOP
        self._edges = 0
        self.on_ticks = 0
        self.doubled = 0

    def period(
        self, coast: bool, duty: float, dead: float, load_nm: float
    ) -> tuple[float, float, Sequence[int]]:
        """The tool's PWM period with modified edges."""
        current, supply, edges = self._tool.period(coast, duty, dead, load_nm)
        begin, self._begin = self._begin, self._begin + CYCLES_PER_PERIOD
        return current, supply, self._disturbed(list(edges), begin) if edges else edges

    def _disturbed(self, edges: list[int], begin: int) -> list[int]:
        self._edges += 1
        tick = -begin % TICK
        if tick < CYCLES_PER_PERIOD and len(edges) == 1:
            self.on_ticks += 1
            # the noise canceller of the capture delays by 4
            return [min(max(tick - 12 + self._edges % 17, 0), CYCLES_PER_PERIOD - 1)]
        if self._edges % 23 == 0 and edges[0] < 60:
            self.doubled += 1
            return [edges[0], edges[0] + 420]
        return [] if self._edges % 331 == 0 else edges


class SettledSwitches:
    """A board whose switches do not change around a tick: the value that a tick reads from a
    changing pin depends on the latency, also on silicon.
    """

    def __init__(self, board: TapeBoard) -> None:
        self._board = board
        self._begin = FIRST_TOP
        self._switches = 0

    def period(self, inputs: BoardInputs) -> BoardOutputs:
        """The board's PWM period; switches are constant for two periods from a tick on."""
        since_tick, self._begin = self._begin % TICK, self._begin + CYCLES_PER_PERIOD
        if 2 * CYCLES_PER_PERIOD <= since_tick < TICK - CYCLES_PER_PERIOD:
            self._switches = inputs.switches
        return self._board.period(inputs._replace(switches=self._switches))


def _frames() -> list[tuple[float, bytes]]:
    """Commands of each kind, one of them damaged."""

    def frame(time_s: float, name: str, **signals: float) -> tuple[float, bytes]:
        return time_s, telemetry.frame_bytes(
            telemetry.frame_of_signals(name, round(time_s * 1000), **signals)
        )

    slew = next(
        i for i, p in enumerate(telemetry.parameter_list()) if p.name.lower().startswith("slew")
    )
    time_s, damaged = frame(3.3, "PARAM_READ", read_index=1, read_sequence=9)
    return [
        frame(0.7, "DUMP", dump_sequence=1),
        frame(1.7, "PARAM_WRITE", write_index=slew, write_value=150, write_sequence=2),
        frame(1.9, "PARAM_READ", read_index=slew, read_sequence=3),
        frame(2.4, "PARAM_WRITE", write_index=slew, write_value=10**6, write_sequence=4),
        frame(2.5, "SETPOINT", setpoint_which=0, setpoint_value=20000, setpoint_sequence=5),
        (time_s, damaged[:9] + bytes([damaged[9] ^ 0x10]) + damaged[10:]),
        frame(3.8, "SET_MODE", mode_request=0, mode_sequence=6),
        frame(4.4, "PARAM_WRITE", write_index=slew, write_value=196, write_sequence=7),
        frame(6.3, "CALIBRATE", calibrate_what=0, calibrate_sequence=8),
        frame(8.5, "DUMP", dump_sequence=10),
    ]


@cache
def record_tape(duration_s: float = DURATION_S, seed: int = 5) -> tuple[bytes, DisturbedEdges]:
    """Tape of a native run of the exercise, and its tool."""
    tool = DisturbedEdges(make_plant(without_board_effects(read_rig(RIG)), seed))
    board = TapeBoard(SilBoard(target=1))
    front = FrontEnds(current_noise_a=0.3, supply_noise_v=0.03)
    lockstep.run(
        SettledSwitches(board),
        tool,
        PROFILE,
        duration_s,
        lockstep.LockstepOptions(front=front, line=lockstep.Script(_frames()), seed=seed),
    )
    return bytes(board.tape), tool
