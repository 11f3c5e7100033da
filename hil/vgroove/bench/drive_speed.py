"""The drivetrain alone against general-purpose solvers: one log-like run at equal accuracy, and
what sensitivities of a run cost.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vgroove import _core
from vgroove.bench.hall_column import edge_times, hall_channel
from vgroove.bench.own import parameters
from vgroove.bench.timing import medians
from vgroove.gap.residual.channels import SpanChannel

Floats = npt.NDArray[np.float64]

Solver = Callable[[Floats, Floats, Floats, float], Floats]
Done = Callable[[str], None]

ACCURACY = 1e-4  # largest speed error over the run / largest speed
DIFFERENCE = 1e-3  # relative change of a parameter for its sensitivity
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
BUS_V = 18.0
SLEW_PER_S = 6.0
MOTOR = {
    "resistance_ohm": 0.19,
    "inductance_h": 1e-4,
    "torque_constant_nm_per_a": 0.0109,
    "inertia_kg_m2": 1.6e-5,
    "viscous_nm_s_per_rad": 4.5e-6,
    "coulomb_nm": 0.012,
}
OWN, SENSITIVITIES = "vgroove with Hall", "vgroove, sensitivities"
GEARBOX = {"ratio": 5.6, "output_inertia_kg_m2": 6e-5}


@dataclass(frozen=True)
class DriveFigure:
    """Median seconds (wall and processor) of one solver for the run and its error against the
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
    """Rows of a log (time, duty at the row's end) and the stretches of one slope that a general
    solver integrates at a time.
    """

    time_s: Floats
    duty: Floats
    stretches: list[tuple[int, int]]


def staircase_run(seconds: int, seed: int) -> Run:
    """A staircase of forward duties with ramps at the trigger's slew rate, 1 kHz rows."""
    rng = np.random.default_rng(seed)
    steps = np.repeat(rng.uniform(0.3, 1.0, 2 * seconds), 500)
    duty = np.zeros(steps.size + 1)
    for row in range(1, duty.size):
        duty[row] = duty[row - 1] + np.clip(
            steps[row - 1] - duty[row - 1], -SLEW_PER_S * 1e-3, SLEW_PER_S * 1e-3
        )
    bends = np.flatnonzero(np.abs(np.diff(duty, 2)) > 1e-12) + 1
    knots = [0, *bends.tolist(), duty.size - 1]
    return Run(
        np.arange(duty.size) * 1e-3,
        duty,
        [(a, b) for a, b in zip(knots, knots[1:], strict=False) if b > a],
    )


def peer_parameters(run: Run, first: int, last: int) -> Floats:
    """Parameters of drive_peers._derivative for one stretch."""
    slope = (run.duty[last] - run.duty[first]) / (run.time_s[last] - run.time_s[first])
    inertia = MOTOR["inertia_kg_m2"] + GEARBOX["output_inertia_kg_m2"] / GEARBOX["ratio"] ** 2
    return np.array(
        [
            BUS_V * run.duty[first],
            BUS_V * slope,
            run.time_s[first],
            MOTOR["resistance_ohm"],
            MOTOR["inductance_h"],
            MOTOR["torque_constant_nm_per_a"],
            inertia,
            MOTOR["viscous_nm_s_per_rad"],
            MOTOR["coulomb_nm"],
        ]
    )


def peer_states(run: Run, solver: Solver, rtol: float) -> Floats:
    """Motor speed rad/s and angle rad at the rows, (n, 2)."""
    found = np.zeros((run.time_s.size, 2))
    state = np.zeros(3)
    for first, last in run.stretches:
        states = solver(
            run.time_s[first : last + 1], state, peer_parameters(run, first, last), rtol
        )
        found[first : last + 1] = states[:, 1:]
        state = states[-1].copy()
    return found


def own_parameters() -> Floats:
    """The tool of physics.md in the order of _core.PARAMETERS."""
    motor, gearbox = (
        {f"motor.{k}": v for k, v in MOTOR.items()},
        {f"gearbox.{k}": v for k, v in GEARBOX.items()},
    )
    return parameters({"supply.voltage_v": BUS_V} | motor | gearbox)


def own_run(run: Run, theta: Floats, hall: SpanChannel) -> Callable[[], tuple[Floats, Floats]]:
    """A call that runs theta (B, P) along the rows on one thread: motor speed rad/s (B, n) and Hall
    column (B, m).
    """
    log, start, state = (
        _core.LogInput(run.time_s, "duty", run.duty, SLEW_PER_S),
        np.array([0]),
        np.zeros((1, 3)),
    )

    def work() -> tuple[Floats, Floats]:
        rows = _core.simulate_log(log, theta, start, state, threads=1)
        return rows["speed_rad_s"], hall.model(rows)

    return work


def difference_sets() -> Floats:
    """The tool and the same with each of its motor's and gear's numbers changed a little, (1 + K,
    P).
    """
    nominal = own_parameters()
    names = [f"motor.{key}" for key in MOTOR] + [f"gearbox.{key}" for key in GEARBOX]
    places = [_core.PARAMETERS.index(name) for name in names]
    sets = np.repeat(nominal[None, :], 1 + len(places), axis=0)
    sets[np.arange(len(places)) + 1, places] *= 1.0 + DIFFERENCE
    return sets


def speed_error(speed: Floats, reference: Floats) -> float:
    return float(np.max(np.abs(speed - reference)) / np.max(reference))


def loosest(solver: Solver, run: Run, reference: Floats) -> tuple[float, float]:
    """Tolerance and error: the loosest tolerance that reaches ACCURACY, else the one that comes
    nearest.
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
    """The peers that are on this machine."""
    from vgroove.bench.drive_peers import LOADERS

    found = {}
    for name, load in LOADERS.items():
        try:
            found[name] = load()
        except ImportError:
            continue
    return found


def own_error(rows: tuple[Floats, Floats], reference: Floats, hall: SpanChannel) -> float:
    """The larger of the errors of the shaft's speed and of the Hall column."""
    return max(speed_error(rows[0][0], reference), speed_error(rows[1][0], hall.measured))


def measure_drive(
    seconds: int, seed: int, repeats: int, done: Done
) -> tuple[list[DriveFigure], float]:
    """Ours (with the Hall column) and the peers on one staircase; and the runs that one sensitivity
    costs (differences in one call).
    """
    from vgroove.bench.drive_peers import scipy_lsoda

    run = staircase_run(seconds, seed)
    reference = peer_states(run, scipy_lsoda, 1e-11)
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
    taken = medians(works, repeats, lambda name: done(f"drivetrain: {name}"))
    length = float(run.time_s[-1])
    figures = [
        DriveFigure(
            name,
            taken[name].wall,
            taken[name].cpu,
            length / taken[name].wall,
            error,
            bool(error <= ACCURACY),
            rtol,
        )
        for name, (rtol, error) in chosen.items()
    ]
    return figures, (taken[SENSITIVITIES].cpu / taken[OWN].cpu - 1.0) / (len(sets) - 1)
