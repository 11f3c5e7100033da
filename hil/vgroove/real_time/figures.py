"""Figures of a run in real time: period and jitter of the exchange, latency, execution time of the
tool's step, overruns, losses, and the board's clock against the host's.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from vgroove.real_time.exchange import Exchange, RealTimeRun
from vgroove.real_time.frames import TICK_S

QUANTILES = (("median", 50.0), ("99 %", 99.0), ("99.9 %", 99.9), ("worst", 100.0))
WINDOW = 250  # exchanges; the least delay of each enters the fit of the clocks
LEAST_WINDOWS = 8  # of a short run, whose windows are shorter
MAX_DRIFT = 0.1  # above that of any oscillator: an RC oscillator of an AVR has 10 %
LISTED = 20  # late steps named one by one


@dataclass(frozen=True)
class ClockFit:
    """Host clock = board clock (1 + drift) + offset. Fitted to the least delay of each window, by
    the median slope of all pairs (Theil-Sen), so that late exchanges do not enter. The offset
    holds the least delay of an answer as well. `residual_s`: standard deviation about the line.
    """

    offset_s: float
    drift: float
    residual_s: float

    def to_host(self, board_s: np.ndarray) -> np.ndarray:
        """Times of the host's clock for times of the board's."""
        return board_s * (1.0 + self.drift) + self.offset_s


def fit_clock(host_s: np.ndarray, board_s: np.ndarray) -> ClockFit:
    """Offset and drift of two clocks from the times (n,) of exchanges. The second pass takes the
    least delays about the first one's line: along a drift the first exchange of a window has the
    least delay otherwise.
    """
    delay, drift = host_s - board_s, 0.0
    window = max(1, min(WINDOW, len(delay) // LEAST_WINDOWS))
    for _ in range(2):
        about = delay - drift * board_s
        starts = range(0, len(delay), window)
        least = np.array([k + int(np.argmin(about[k : k + window])) for k in starts])
        x, y = board_s[least], delay[least]
        first, second = np.triu_indices(len(x), 1)
        far = x[second] > x[first]
        slopes = (y[second] - y[first])[far] / (x[second] - x[first])[far]
        drift = float(np.median(slopes)) if len(slopes) else 0.0
    offset = float(np.median(y - drift * x))
    return ClockFit(offset, drift, float(np.std(y - drift * x - offset)))


def quantiles(values: np.ndarray) -> dict[str, float]:
    """Median, 99 %, 99.9 % and worst of values (n,)."""
    return {name: float(np.percentile(values, share)) for name, share in QUANTILES}


LEAST_EXCHANGES = 3  # a latency spans three exchanges


def timing_figures(run: RealTimeRun) -> dict[str, Any]:
    """All figures of a run with at least LEAST_EXCHANGES exchanges."""
    exchanges = run.exchanges
    received = np.array([e.received_s for e in exchanges])
    board = np.array([e.board_s for e in exchanges])
    tick = np.array([e.tick for e in exchanges])
    clock_ticks = np.floor(board / TICK_S + 1e-6).astype(int)
    period = np.diff(received)
    held = np.diff(clock_ticks) - np.diff(tick)
    # the answer to the command of tick k is in the command of tick k + 2
    latency = clock_ticks[2:] - clock_ticks[:-2]
    late = np.flatnonzero(held) + 1
    clock, pauses = fit_clock(received, board), run.pauses
    corrupt, skipped = run.counters.corrupt, run.counters.skipped_bytes
    return {
        "exchanges": len(exchanges),
        "planned_exchanges": run.planned,
        "ended": run.ended,
        "period_s": quantiles(period),
        "jitter_s": quantiles(np.abs(period - np.median(period))),
        "step_s": quantiles(np.array([e.step_s for e in exchanges])),
        "latency_ticks": quantiles(latency),
        "held_ticks": int(held.sum()),
        "late_steps": [
            {
                "tick": int(tick[k]),
                "held_ticks": int(held[k - 1]),
                "pause_of_computer": pauses is not None and pauses.explain(float(received[k])),
            }
            for k in late
        ],
        "pauses_of_computer": None
        if pauses is None
        else {"count": len(pauses.spans), "worst_s": pauses.worst_s()},
        "safe_after_ticks": run.safe_ticks,
        "frames_damaged": corrupt,
        "bytes_skipped": skipped,
        "sent_again": run.sent_again,
        "real_time_priority": run.prioritised,
        "clock": {**asdict(clock), "drift_ppm": 1e6 * clock.drift},
    }


def timing_rows(exchanges: Sequence[Exchange], clock: dict[str, float]) -> list[list[float]]:
    """Rows of the timing file: tick, host time, board time, board time on the host's clock, delay
    beyond the least one, execution time of the step; times in s from the first exchange on.
    """
    fit = ClockFit(clock["offset_s"], clock["drift"], clock["residual_s"])
    first = exchanges[0].received_s
    rows = []
    for e in exchanges:
        corrected = float(fit.to_host(np.array(e.board_s)))
        delay = e.received_s - corrected
        rows.append([e.tick, e.received_s - first, e.board_s, corrected - first, delay, e.step_s])
    return rows


def clock_sentence(clock: dict[str, float]) -> str:
    """By how many ppm the board's clock is faster or slower than the host's; where it is by more
    than any oscillator, as with a simulated board and --pace, the rate of the board's clock.
    """
    residual = f"{1e3 * clock['residual_s']:.3f} ms about the line"
    rate = 1.0 / (1.0 + clock["drift"])
    if abs(clock["drift"]) > MAX_DRIFT:
        return f"the board's clock runs at {rate:.2f} of the host's, {residual}"
    off, kind = 1e6 * abs(rate - 1.0), "faster" if rate > 1.0 else "slower"
    return f"the board's clock is {off:.1f} ppm {kind} than the host's, {residual}"


def late_sentence(figures: dict[str, Any]) -> str:
    """Which steps were late and how many of them because the computer stood still, or that none
    was.
    """
    late = figures["late_steps"]
    if not late:
        return "no step was late"
    named = ", ".join(f"{step['tick']} (+{step['held_ticks']} ms)" for step in late[:LISTED])
    more = f" and {len(late) - LISTED} more" if len(late) > LISTED else ""
    text = f"{len(late)} steps were late, the board waited at tick {named}{more}"
    pauses = figures["pauses_of_computer"]
    if pauses is None:
        return text
    within = sum(step["pause_of_computer"] for step in late)
    worst_ms = 1e3 * pauses["worst_s"]
    return (
        f"{text}; {within} of them while the computer itself stood still (up to {worst_ms:.1f} ms)"
    )
