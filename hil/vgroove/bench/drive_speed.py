"""The drivetrain alone against general-purpose solvers at equal accuracy, and the cost of the
sensitivities of a run.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vgroove import _core
from vgroove.bench.hall_column import edge_times, hall_channel
from vgroove.bench.own import ROW_S, drive_values, parameters
from vgroove.bench.timing import Seconds, medians
from vgroove.gap.residual.channels import SpanChannel
from vgroove.progress import Tick

Floats = npt.NDArray[np.float64]

# times (n,), start (3,), parameters, relative tolerance -> states (n, 3)
Solver = Callable[[Floats, Floats, Floats, float], Floats]

ACCURACY = 1e-4  # largest error of the speed over the run, of the largest speed
DIFFERENCE = 1e-3  # relative change of a parameter for its sensitivity
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
REFERENCE_TOLERANCE = 1e-11
BUS_V = 18.0  # stiff supply
SLEW_PER_S = 6.0  # of the duty
STEPS_PER_S, STEP_ROWS = 2, 500  # of the staircase
DUTIES = (0.3, 1.0)  # range of the drawn steps
BEND = 1e-12  # a smaller second difference of the duty is no bend
OWN, SENSITIVITIES = "vgroove with Hall", "vgroove, sensitivities"


@dataclass(frozen=True)
class DriveFigure:
    """Median wall and processor seconds of one solver for the run, and its error against the
    reference.
    """

    name: str
    seconds: float
    cpu_seconds: float
    times_real_time: float
    speed_error: float
    reached: bool
    rtol: float | None = None


@dataclass(frozen=True)
class Run:
    """Rows of a log, (n,) each: time and duty at the end of a row; the segments (first row, last
    row) of constant slope, which a general solver integrates one by one.
    """

    time_s: Floats
    duty: Floats
    segments: list[tuple[int, int]]


def staircase_run(seconds: int, seed: int) -> Run:
    """A staircase of forward duties at rows of 1 ms, with ramps of the trigger's slew rate."""
    rng = np.random.default_rng(seed)
    steps = np.repeat(rng.uniform(*DUTIES, STEPS_PER_S * seconds), STEP_ROWS)
    duty = np.zeros(steps.size + 1)
    for row in range(1, duty.size):
        duty[row] = duty[row - 1] + np.clip(
            steps[row - 1] - duty[row - 1], -SLEW_PER_S * ROW_S, SLEW_PER_S * ROW_S
        )
    bends = np.flatnonzero(np.abs(np.diff(duty, 2)) > BEND) + 1
    knots = [0, *bends.tolist(), duty.size - 1]
    return Run(
        np.arange(duty.size) * ROW_S,
        duty,
        [(a, b) for a, b in zip(knots, knots[1:], strict=False) if b > a],
    )


def peer_parameters(run: Run, first: int, last: int) -> Floats:
    """Parameters of drive_peers._derivative for one segment."""
    drive = drive_values()
    slope = (run.duty[last] - run.duty[first]) / (run.time_s[last] - run.time_s[first])
    behind = drive["gearbox.output_inertia_kg_m2"] / drive["gearbox.ratio"] ** 2
    return np.array(
        [
            BUS_V * run.duty[first],
            BUS_V * slope,
            run.time_s[first],
            drive["motor.resistance_ohm"],
            drive["motor.inductance_h"],
            drive["motor.torque_constant_nm_per_a"],
            drive["motor.inertia_kg_m2"] + behind,
            drive["motor.viscous_nm_s_per_rad"],
            drive["motor.coulomb_nm"],
        ]
    )


def peer_states(run: Run, solver: Solver, rtol: float) -> Floats:
    """Motor speed in rad/s and angle in rad at the rows, (n, 2), by a peer."""
    found = np.zeros((run.time_s.size, 2))
    state = np.zeros(3)
    for first, last in run.segments:
        states = solver(
            run.time_s[first : last + 1], state, peer_parameters(run, first, last), rtol
        )
        found[first : last + 1] = states[:, 1:]
        state = states[-1].copy()
    return found


def own_parameters() -> Floats:
    """The reference drive on a stiff supply, in the order of _core.PARAMETERS."""
    return parameters(drive_values() | {"supply.voltage_v": BUS_V, "supply.resistance_ohm": 0.0})


def own_run(run: Run, theta: Floats, hall: SpanChannel) -> Callable[[], tuple[Floats, Floats]]:
    """A call that runs tools theta (B, P) along the rows on one thread and returns the motor speed
    in rad/s (B, n) and the Hall column (B, m).
    """
    log = _core.LogInput(run.time_s, "duty", run.duty, SLEW_PER_S)
    start, state = np.array([0]), np.zeros((1, 3))

    def work() -> tuple[Floats, Floats]:
        rows = _core.simulate_log(log, theta, start, state, threads=1)
        return rows["speed_rad_s"], hall.model(rows)

    return work


def difference_sets() -> Floats:
    """The drive, and the drive with each of the K values of motor and gearbox changed by
    DIFFERENCE, (1 + K, P).
    """
    nominal = own_parameters()
    names = [name for name in drive_values() if not name.startswith("supply.")]
    places = [_core.PARAMETERS.index(name) for name in names]
    sets = np.repeat(nominal[None, :], 1 + len(places), axis=0)
    sets[np.arange(len(places)) + 1, places] *= 1.0 + DIFFERENCE
    return sets


def speed_error(speed: Floats, reference: Floats) -> float:
    """Largest difference of speeds (n,), of the largest reference speed."""
    return float(np.max(np.abs(speed - reference)) / np.max(reference))


def loosest(solver: Solver, run: Run, reference: Floats) -> tuple[float, float]:
    """Tolerance and error of a peer at the loosest tolerance that reaches ACCURACY, else at the one
    of the least error.
    """
    tried: list[tuple[float, float]] = []
    for rtol in TOLERANCES:
        error = speed_error(peer_states(run, solver, rtol)[:, 0], reference)
        tried.append((error if np.isfinite(error) else np.inf, rtol))
        if error <= ACCURACY:
            break
    error, rtol = min(tried) if tried[-1][0] > ACCURACY else tried[-1]
    return rtol, error


def load_solvers() -> dict[str, Solver]:
    """The peers that this machine has."""
    from vgroove.bench.drive_peers import LOADERS

    found = {}
    for name, load in LOADERS.items():
        try:
            found[name] = load()
        except ImportError:
            continue
    return found


def own_error(rows: tuple[Floats, Floats], reference: Floats, hall: SpanChannel) -> float:
    """The larger one of the errors of the shaft's speed and of the Hall column."""
    return max(speed_error(rows[0][0], reference), speed_error(rows[1][0], hall.measured))


def measure_drive(
    seconds: int, seed: int, repeats: int, tick: Tick
) -> tuple[list[DriveFigure], float]:
    """The plant (with the Hall column) and the peers on one staircase; and the cost of one
    sensitivity, by differences in one call, in runs.
    """
    from vgroove.bench.drive_peers import scipy_lsoda

    run = staircase_run(seconds, seed)
    reference = peer_states(run, scipy_lsoda, REFERENCE_TOLERANCE)
    hall = hall_channel(run.time_s, edge_times(run.time_s, reference[:, 1], reference[:, 0]))
    sets = difference_sets()
    one, many = own_run(run, sets[:1], hall), own_run(run, sets, hall)
    works: dict[str, Callable[[], object]] = {OWN: one, SENSITIVITIES: many}
    chosen: dict[str, tuple[float | None, float]] = {
        OWN: (None, own_error(one(), reference[:, 0], hall))
    }
    for name, solver in load_solvers().items():
        rtol, error = loosest(solver, run, reference[:, 0])
        chosen[name] = (rtol, error)
        works[name] = lambda solver=solver, rtol=rtol: peer_states(run, solver, rtol)
    taken = medians(works, repeats, lambda name: tick(f"drivetrain: {name}"))
    length = float(run.time_s[-1])
    figures = [figure_of(name, taken[name], length, *chosen[name]) for name in chosen]
    return figures, (taken[SENSITIVITIES].cpu / taken[OWN].cpu - 1.0) / (len(sets) - 1)


def figure_of(
    name: str, taken: Seconds, length_s: float, rtol: float | None, error: float
) -> DriveFigure:
    """The figure of a timed solver for a run of length_s."""
    reached = bool(error <= ACCURACY)
    return DriveFigure(name, taken.wall, taken.cpu, length_s / taken.wall, error, reached, rtol)
