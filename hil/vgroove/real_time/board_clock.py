"""The board's clock from its DRIVE frames, which carry the low byte of its tick counter."""

from collections import deque
from statistics import median_high

from vgroove.real_time.frames import CLOCK_COUNT_S, TICK_S, Drive

WRAP_TICKS = 256  # of the low byte
SAFE_TICKS = 5  # without inputs, after which the board opens the bridge (firmware/hal/inject)
SPAN = 16  # exchanges of which one estimate of the rate is made
RATES = 63  # estimates of the rate of which the median is taken
PROMPT_TICKS = 32  # in which inputs reach the board, unless they or the answer were held up


class BoardClock:
    """The board's clock in s, from the first frame's tick on.

    The low byte of the tick counter wraps every 256 ms. Less than that passes from one tick to the
    next, unless the board waits for inputs. After such a wait the number of wraps follows from the
    host's clock, scaled by the rate of the board's (s in one of the host's). The rate is the median
    of the rates of spans of 16 exchanges; in the first span no wraps are resolved.
    """

    def __init__(self) -> None:
        self._ticks: int | None = None
        self._span: list[tuple[float, float]] = []  # host clock and board clock, s
        self._rates: deque[float] = deque(maxlen=RATES)
        self._rate = 0.0
        # host clock and board clock, s, of the last span's exchange of the least delay
        self._prompt = (0.0, 0.0)

    def seconds(self, drive: Drive, waited: bool, sent_s: float, received_s: float) -> float:
        """Time at which the tick of a frame began. waited: the board has opened the bridge because
        the tick's inputs were missing; sent_s, received_s: when the host sent the tick's inputs and
        received the frame (host clock).
        """
        if self._ticks is None:
            self._ticks = self._first = drive.clock_tick
        step = (drive.clock_tick - self._ticks) % WRAP_TICKS
        if waited or step > SAFE_TICKS:  # the frame of the opened bridge may have been lost
            if self._rates:
                step += WRAP_TICKS * self._wraps(step, sent_s, received_s)
            self._span = []
        self._ticks += step
        board_s = (self._ticks - self._first) * TICK_S + drive.clock_count * CLOCK_COUNT_S
        self._estimate_rate(received_s, board_s)
        return board_s

    def _wraps(self, step: int, sent_s: float, received_s: float) -> int:
        """Whole wraps of the low byte during a wait.

        The tick began soon after its inputs were sent, also where the host read the answer late.
        Where no number of wraps agrees with that, the inputs were held up on the line, and the tick
        began soon before the answer was received.
        """
        after_sent = self._wraps_until(sent_s, step)
        wraps = max(0, round(after_sent))
        if WRAP_TICKS * abs(after_sent - wraps) <= PROMPT_TICKS:
            return wraps
        return max(0, round(self._wraps_until(received_s, step)))

    def _wraps_until(self, host_s: float, step: int) -> float:
        """Wraps, with fraction, from `step` ticks after the last frame's tick to a time of the
        host's clock.
        """
        prompt_host_s, prompt_board_s = self._prompt
        board_s = prompt_board_s + self._rate * (host_s - prompt_host_s)
        return (board_s / TICK_S - (self._ticks - self._first + step)) / WRAP_TICKS

    def _estimate_rate(self, host_s: float, board_s: float) -> None:
        self._span.append((host_s, board_s))
        if len(self._span) <= SPAN:
            return
        (begin_host_s, begin_board_s), *_ = self._span
        if host_s > begin_host_s:
            self._rates.append((board_s - begin_board_s) / (host_s - begin_host_s))
            self._rate = median_high(self._rates)  # an answer read late lowers the rate
            self._prompt = max(self._span, key=lambda at: at[1] - self._rate * at[0])
        self._span = [(host_s, board_s)]
