"""Disturbances of real logs, each of zero mean: small random deviations of supply, friction,
bridge, sensors and logger that no effect of the catalogue describes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from profiles import Profile, sampled
from signals import COUNTING_EDGES, RPM_PER_RAD_S, Sensors
from truth import Command, Run

TURN = 2.0 * np.pi
TABLE_S = 0.01  # between the points of a disturbance over time
WANDER_S = (0.7, 3.0)  # periods of a slow drift; longer ones resemble a trend
SLIP_S = 0.04  # least time between two slips of an encoder
NODE_S = 0.06  # between two draws of the delay where the command has no edges
SETTLE_S = 0.01  # before an edge, in which the delay changes from that of the edge before
LARGEST = 2.2  # of a random delay, in RMS values, before its mean is removed again
BURST_S = (0.01, 0.06)  # length of a burst of noise
BURSTS_PER_S = 3.0
ROUGH_STEP_RAD = 0.05
ROUGH_TURNS = (11.0, 17.0)  # turns after which the roughness of a bearing repeats
ROUGH_ORDERS = (0.3, 6.0)  # of the roughness, per turn
BARS = (5, 7, 9, 11)  # of a commutator; each gives two ripples a turn
TEETH = (12, 40)  # of the gear wheel that has one tooth more or less
DISPLACED_SHARE = 0.3  # of the turns in which an edge is displaced
SLIP_COUNTS = (2, 8)  # of an encoder of the angle


@dataclass(frozen=True)
class Disturbance:
    """One disturbance: its id (KINDS), its size in the unit of its kind, and the seed of its random
    numbers. Of size 0 it changes nothing.
    """

    id: str
    size: float
    seed: int

    def random(self) -> np.random.Generator:
        return np.random.default_rng([self.seed, *self.id.encode()])


# --- processes of zero mean and RMS 1


def unit(values: np.ndarray, *against: np.ndarray) -> np.ndarray:
    """Values (n,) without their mean and their regression on `against`, with RMS 1."""
    table = np.array([np.ones(len(values)), *against]).T
    left = values - table @ np.linalg.lstsq(table, values, rcond=None)[0]
    return left / max(float(np.sqrt(np.mean(left**2))), 1e-12)


def wander(time_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A slow random drift (n,) without mean and trend: six sines of random period and phase."""
    periods = np.exp(rng.uniform(*np.log(WANDER_S), 6))
    phases = rng.uniform(0.0, TURN, 6)
    sines = np.sin(TURN * time_s[:, None] / periods + phases) * rng.uniform(0.5, 1.0, 6)
    return unit(sines.sum(axis=1), time_s)


def parts(time_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Levels (n,) that step every 0.8 to 2 s, as of a log joined from several runs."""
    ends = np.cumsum(rng.uniform(0.8, 2.0, 2 + int(time_s[-1] / 0.8)))
    levels = rng.standard_normal(len(ends)) * 0.4 + np.where(np.arange(len(ends)) % 2, 1.0, -1.0)
    return unit(levels[np.searchsorted(ends, time_s)], time_s)


def roughness(rng: np.random.Generator) -> np.ndarray:
    """A torque over the angle at steps of ROUGH_STEP_RAD: sines of forty orders that are no whole
    numbers, falling with the root of the order.
    """
    turns = float(rng.uniform(*ROUGH_TURNS))
    count = round(turns * TURN / ROUGH_STEP_RAD)
    places = np.arange(round(ROUGH_ORDERS[0] * turns), round(ROUGH_ORDERS[1] * turns))
    chosen = rng.choice(places, min(40, len(places)), replace=False)
    angle = TURN * np.arange(count) / count
    waves = np.sin(np.outer(angle, chosen) + rng.uniform(0.0, TURN, len(chosen)))
    return unit(waves @ (1.0 / np.sqrt(chosen)))


def heavy_tailed(count: int, rng: np.random.Generator) -> np.ndarray:
    """Noise (n,) of Student's t distribution with 3 degrees of freedom, of standard deviation 1."""
    return rng.standard_t(3, count) / 3.0**0.5


# --- command, supply, friction, gear


def disturbed_command(
    disturbances: tuple[Disturbance, ...], made: Command, profile: Profile, seconds: float
) -> Command:
    """The command as it acts: with late and early edges, and with the drift of supply, friction and
    bearings.
    """
    active = {d.id: d for d in disturbances if d.size}
    out = made
    if d := active.get("command_jitter"):
        out = replace(out, time_s=out.time_s + delays(d, profile, seconds, out.time_s))
    tables = {"supply_sag": "extra_supply_v", "friction_drift": "extra_coulomb_nm"}
    time_s = np.arange(0.0, seconds + TABLE_S, TABLE_S)
    for name, column in tables.items():
        if d := active.get(name):
            if not len(out.extra_time_s):
                zero = np.zeros(len(time_s))
                out = replace(out, extra_time_s=time_s, extra_supply_v=zero, extra_coulomb_nm=zero)
            out = replace(out, **{column: drift(d, time_s)})
    if d := active.get("bearing_roughness"):
        rough = d.size * roughness(d.random())
        out = replace(out, rough_nm=rough, rough_step_rad=ROUGH_STEP_RAD)
    return out


def drift(d: Disturbance, time_s: np.ndarray) -> np.ndarray:
    """Supply or friction over time (n,): half of the supplies step between parts of the log."""
    rng = d.random()
    steps = d.id == "supply_sag" and rng.uniform() < 0.5
    return d.size * (parts if steps else wander)(time_s, rng)


def delays(d: Disturbance, profile: Profile, seconds: float, at_s: np.ndarray) -> np.ndarray:
    """Delay less its mean at the points (n,) of a command: one draw for each edge, or one every
    NODE_S of a smooth command.
    """
    rng = d.random()
    edges = np.arange(0.0, seconds, NODE_S) if profile.smooth else profile.time_s
    drawn = rng.gamma(2.0, 1.0, len(edges))
    late = d.size * unit(np.clip(unit(drawn), -LARGEST, LARGEST))
    if profile.smooth:
        return np.interp(at_s, edges, late)
    # constant around an edge; the change to the next delay lies before the next edge
    ends = np.append(edges[1:], seconds + 1.0)
    nodes = np.array([edges - SETTLE_S, ends - 3.0 * SETTLE_S]).T.ravel()
    return np.interp(at_s, nodes, np.repeat(late, 2))


def disturbed_tool(disturbances: tuple[Disturbance, ...], ratio: float) -> dict[str, float]:
    """Parameters of a tool whose gear has a tooth more or less than the rig's ratio says.

    Load and inertia of the output side differ by a constant factor, which the catalogue describes.
    What remains is the period of the output side's torque ripple: `size` is its amplitude at the
    motor.
    """
    for d in disturbances:
        if d.id == "gear_tooth" and d.size:
            rng = d.random()
            tooth = float(rng.choice([-1.0, 1.0])) / float(rng.integers(*TEETH, endpoint=True))
            per_rev = 1.0 / (ratio * (1.0 + tooth))
            return {"u_ripple_nm": d.size, "u_ripple_per_rev": per_rev, "u_ripple_wander": 0.0}
    return {}


# --- logger and sensors


def disturbed_stamps(disturbances: tuple[Disturbance, ...], stamps: np.ndarray) -> np.ndarray:
    """Time stamps (n,) of a logger that receives its rows in batches: within a batch they are drawn
    together towards its middle by the size (0: none, 1: one time), so that their mean is right.
    """
    for d in disturbances:
        if d.id == "row_batches" and d.size:
            count = int(d.random().integers(3, 9))
            batch = np.arange(len(stamps)) // count
            middle = (np.bincount(batch, stamps) / np.bincount(batch))[batch]
            stamps = np.round(stamps + d.size * (middle - stamps), 6)
            stamps = np.maximum.accumulate(stamps - 1e-6 * np.arange(len(stamps)))
            stamps = np.round(stamps + 1e-6 * np.arange(len(stamps)), 6)
    return stamps


def disturbed_run(
    disturbances: tuple[Disturbance, ...], run: Run, made: Command, sensors: Sensors
) -> Run:
    """The run as disturbed sensors measure it."""
    for d in disturbances:
        if d.size and d.id in SENSED:
            run = SENSED[d.id](d, run, made, sensors)
    return run


def _with_current(run: Run, extra_a: np.ndarray) -> Run:
    return replace(run, current_a=run.current_a + extra_a)


def _supply_current(d: Disturbance, run: Run, made: Command, sensors: Sensors) -> Run:
    """A current that is measured in the supply line and divided by a mean duty: a share of it is
    proportional to the duty. The mean gain is that of the motor's current.
    """
    duty = np.abs(sampled(made.time_s, made.duty, run.time_s))
    power = np.sum(run.current_a**2)
    mean = np.sum(duty * run.current_a**2) / max(float(power), 1e-12)
    return _with_current(run, d.size * run.current_a * (duty - mean))


def _heavy_noise(d: Disturbance, run: Run, made: Command, sensors: Sensors) -> Run:
    return _with_current(run, d.size * heavy_tailed(len(run.time_s), d.random()))


def _bursts(d: Disturbance, run: Run, made: Command, sensors: Sensors) -> Run:
    """Noise of standard deviation `size` within bursts at random times."""
    rng = d.random()
    count = 1 + rng.poisson(BURSTS_PER_S * run.time_s[-1])
    begin = rng.uniform(0.0, run.time_s[-1], count)
    length = rng.uniform(*BURST_S, count)
    inside = ((run.time_s[:, None] > begin) & (run.time_s[:, None] < begin + length)).any(axis=1)
    return _with_current(run, np.where(inside, d.size * rng.standard_normal(len(inside)), 0.0))


def _speed_noise(d: Disturbance, run: Run, made: Command, sensors: Sensors) -> Run:
    """Noise in rpm of a tachometer."""
    noise = d.size / RPM_PER_RAD_S * heavy_tailed(len(run.time_s), d.random())
    return replace(run, speed_rad_s=run.speed_rad_s + noise)


def _adc(d: Disturbance, run: Run, made: Command, sensors: Sensors) -> Run:
    """Integral nonlinearity of a converter: three waves over the range of the log, without offset
    and gain.
    """
    rng = d.random()
    i = run.current_a
    place = i / max(float(np.max(np.abs(i))), 1e-12)
    waves = np.sin(TURN * np.outer(place, [1.0, 2.0, 3.0]) + rng.uniform(0.0, TURN, 3))
    return _with_current(run, d.size * unit(waves @ rng.uniform(0.3, 1.0, 3), i, np.abs(i)))


def _commutation(d: Disturbance, run: Run, made: Command, sensors: Sensors) -> Run:
    """Ripple of the current by the commutator, relative to the current: mean over each row."""
    rng = d.random()
    order, phase = 2.0 * float(rng.choice(BARS)), float(rng.uniform(0.0, TURN))
    angle = order * np.concatenate([[0.0], run.angle_rad])
    begin, end = angle[:-1] + phase, angle[1:] + phase
    mean = np.cos(0.5 * (begin + end)) * np.sinc(0.5 * (end - begin) / np.pi)
    return _with_current(run, d.size * 2.0**0.5 * run.current_a * mean)


def _displaced_edges(d: Disturbance, run: Run, made: Command, sensors: Sensors) -> Run:
    """One edge of a turn is early or late in some turns, as with play of the sensor's magnet; size:
    RMS of the angle.
    """
    rng = d.random()
    edges, turn = run.edge_s, sensors.hall_pulses_per_rev
    if len(edges) < 2:
        return run
    place = np.cumsum(run.edge_direction).astype(int) % turn == int(rng.integers(turn))
    moved = place & (rng.uniform(size=len(edges)) < DISPLACED_SHARE)
    angle = np.where(moved, d.size * rng.standard_normal(len(edges)), 0.0)
    angle -= np.where(moved, np.sum(angle) / max(np.sum(moved), 1), 0.0)
    pitch = TURN / turn
    period = np.diff(edges, prepend=edges[0] - 1.0)
    late = np.clip(angle / pitch, -0.45, 0.45) * np.minimum(period, np.append(period[1:], 1.0))
    return replace(run, edge_s=edges + late)


def _slips(d: Disturbance, run: Run, made: Command, sensors: Sensors) -> Run:
    """Counts that an encoder loses and gains in turns, `size` a second: of the edges one, of an
    angle SLIP_COUNTS.
    """
    rng = d.random()
    gaps = SLIP_S + rng.exponential(1.0 / d.size, 4 + int(2.0 * d.size * run.time_s[-1]))
    at = np.cumsum(gaps)
    at = at[at < run.time_s[-1]]
    if sensors.hall_pulses_per_rev:
        return _slipped_edges(run, at)
    counts = rng.integers(SLIP_COUNTS[0], SLIP_COUNTS[1] + 1, (len(at) + 1) // 2)
    signs = np.where(rng.uniform(size=len(counts)) < 0.5, 1, -1)
    changes = np.repeat(counts * signs, 2)[: len(at)] * np.where(np.arange(len(at)) % 2, 1, -1)
    total = np.concatenate([[0], np.cumsum(changes)])[np.searchsorted(at, run.time_s)]
    return replace(run, angle_rad=run.angle_rad + sensors.position_lsb_rad * total)


def _slipped_edges(run: Run, at_s: np.ndarray) -> Run:
    """The run with an edge less after each even time and one more after each odd one."""
    found = np.unique(np.searchsorted(run.edge_s, at_s))
    found = found[(found > 0) & (found < len(run.edge_s) - 1)]
    lost, gained = found[::2], found[1::2]
    middle = 0.5 * (run.edge_s[gained] + run.edge_s[gained - 1])
    keep = np.ones(len(run.edge_s), dtype=bool)
    keep[lost] = False
    edges = np.concatenate([run.edge_s[keep], middle])
    ways = np.concatenate([run.edge_direction[keep], run.edge_direction[gained]])
    order = np.argsort(edges, kind="stable")
    return replace(run, edge_s=edges[order], edge_direction=ways[order])


Sensed = Callable[[Disturbance, Run, Command, Sensors], Run]
SENSED: dict[str, Sensed] = {
    "supply_current": _supply_current,
    "heavy_noise": _heavy_noise,
    "noise_bursts": _bursts,
    "speed_noise": _speed_noise,
    "converter": _adc,
    "commutation": _commutation,
    "displaced_edges": _displaced_edges,
    "slips": _slips,
}


IDS = (
    "command_jitter",
    "supply_sag",
    "friction_drift",
    "bearing_roughness",
    "gear_tooth",
    "row_batches",
    *SENSED,
)


def counts_edges(sensors: Sensors) -> bool:
    """Whether the speed is made from edges counted between rows."""
    return sensors.hall_pulses_per_rev >= COUNTING_EDGES
