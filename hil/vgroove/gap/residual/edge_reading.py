"""Hall edges of a log compared with the nominal model: their periods, the mean speed of the model
over each, and the angle that the edges count.
"""

from dataclasses import dataclass, replace

import numpy as np

from vgroove import _core
from vgroove.array_cache import cached_by_content
from vgroove.gap.hall_edges.edge_periods import MIN_COUNTING_PULSES, EdgePeriods
from vgroove.gap.hall_edges.missed_edge_rows import read_edges_with_missed
from vgroove.gap.hall_edges.scale import edge_scale
from vgroove.gap.residual.channels import InterpolationPoints, Simulation
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.immutable import freeze_arrays
from vgroove.gap.residual.state_observer import StateObserver
from vgroove.rig import Rig
from vgroove.units import RPM_PER_RAD_S, TURN_RAD


@dataclass(frozen=True)
class FilteredSpeedTest:
    """A speed column holds no edge periods if they form more chains (uninterrupted sequences of
    edges) than the larger of a number and a share of the periods. Chosen on the tuning half of the
    blind set (docs/gap_bench.md).
    """

    max_chains: int = 20
    max_share: float = 0.2


FILTERED_TEST = FilteredSpeedTest()
# difference in rad between the nominal model and the count at the first edge; above it the angle of
# the nominal model is not used
MAX_START_ERROR_RAD = TURN_RAD
KEPT_LOGS = 8  # logs whose edge periods are kept: bounds the memory


def read_edge_periods(log: CleanLog) -> EdgePeriods | None:
    """Edge periods behind the speed column; None without a Hall wheel, and for a filtered speed."""
    if log.pulses_per_rev == 0 or "speed_rpm" not in log.columns:
        return None
    found = _read_scaled(log)
    whole = found.chain[~found.timeout]
    limit = max(FILTERED_TEST.max_chains, FILTERED_TEST.max_share * len(whole))
    if len(np.unique(whole)) <= limit:
        return found
    log.warn(
        "the speeds are not those of consecutive edge periods (filtered?): compared over the pitch "
        "before each row"
    )
    return None


def _read_scaled(log: CleanLog) -> EdgePeriods:
    """Edge periods of a speed column whose scale against the time stamps need not be 1; speeds stay
    as they were logged.
    """
    time_s, speed_rpm, pulses = log.time_s, log.columns["speed_rpm"], log.pulses_per_rev
    lsb_rpm = log.rig.sensors.get("speed_lsb_rpm", 0.0)
    gaps = int(np.count_nonzero(np.diff(log.thinned.astype(int)) == 1))
    found = _scaled_periods(time_s, speed_rpm, pulses, lsb_rpm, gaps)
    if found.scale != 1.0:
        log.warn(
            "the edge periods behind speed_rpm are consecutive on these time stamps only if the "
            f"speeds are wrong by {100.0 * (found.scale - 1.0):+.3g} %: a wrong gain of the "
            "sensor, or a wrong clock"
        )
    return found


@cached_by_content(most=KEPT_LOGS)
def _scaled_periods(
    time_s: np.ndarray, speed_rpm: np.ndarray, pulses: int, lsb_rpm: float, gaps: int
) -> EdgePeriods:
    """Edge periods of a speed column (n,) and its scale; `gaps`: see edge_scale. They depend on the
    log alone, which a diagnosis loads with several rigs.
    """
    scale = edge_scale(time_s, speed_rpm, pulses, lsb_rpm, gaps)
    found = read_edges_with_missed(time_s, speed_rpm / scale, pulses, lsb_rpm)
    if scale != 1.0:
        found = replace(found, speed_rpm=found.speed_rpm * scale, scale=scale)
    freeze_arrays(found)
    return found


def nominal_motion(plant_input: _core.LogInput, rig: Rig) -> Simulation:
    """Simulation of the nominal model from rest at the first row, without restarts."""
    return _core.simulate_log(
        plant_input,
        rig.parameters()[None],
        np.zeros(1, dtype=int),
        np.zeros((1, 3)),
        threads=1,
        unfinished="nan",
    )


def add_expected_speed(edges: EdgePeriods, time_s: np.ndarray, motion: Simulation) -> EdgePeriods:
    """The edge periods with the mean speed of the nominal model over each; unchanged where the
    simulation did not reach all of them.
    """
    start, end = (
        InterpolationPoints.of(time_s, instants_s).angle(motion)[0]
        for instants_s in (edges.start_s, edges.end_s)
    )
    expected = (end - start) / (edges.end_s - edges.start_s) * RPM_PER_RAD_S
    return replace(edges, expected_rpm=expected) if np.isfinite(expected).all() else edges


def align_count_to_rest(
    observer: StateObserver, edges: EdgePeriods, time_s: np.ndarray, motion: Simulation
) -> StateObserver:
    """The observer with the angle of its count shifted, from the first edge on, to the nominal
    model's angle at that edge.

    The log contains neither the angle between the rest position and the first edge nor the edges
    that a quick start hides between two rows. Without the shift the phase of a cogging would jump
    at the first restart.
    """
    if edges.timeout.all():
        return observer
    first_s = edges.end_s[~edges.timeout][0]
    nominal = float(InterpolationPoints.of(time_s, np.array([first_s])).angle(motion)[0, 0])
    shift = nominal - observer.angle_at(first_s)
    if not abs(shift) < MAX_START_ERROR_RAD:
        return observer
    return replace(
        observer, angle_at=lambda t: observer.angle_at(t) + (shift if t >= first_s else 0.0)
    )


def chain_starts(edges: EdgePeriods | None, pulses: int) -> np.ndarray:
    """Instants (k,) in s at which each chain of edges but the first begins: the number of edges
    since the chain before is unknown. Empty for a sensor that counts edges: its chains end without
    a loss of the count, and one free angle offset for each would fit any ripple.
    """
    if edges is None or pulses >= MIN_COUNTING_PULSES:
        return np.zeros(0)
    whole = np.flatnonzero(~edges.timeout)
    return edges.end_s[whole[1:]][np.diff(edges.chain[whole]) != 0]
