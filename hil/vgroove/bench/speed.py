"""Speed of the drivetrain plant against general-purpose solvers: one log-like run, equal accuracy, medians, one machine."""

import statistics
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass

import numpy as np
import numpy.typing as npt
from rich.table import Table

from vgroove import _core
from vgroove.errors import VgrooveError

Floats = npt.NDArray[np.float64]

ACCURACY = 1e-4  # largest speed error over the run / largest speed
TOLERANCES = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
BUS_V = 18.0
SLEW_PER_S = 6.0
MOTOR = {"resistance_ohm": 0.19, "inductance_h": 1e-4, "torque_constant_nm_per_a": 0.0109, "inertia_kg_m2": 1.6e-5,
         "viscous_nm_s_per_rad": 4.5e-6, "coulomb_nm": 0.012}
GEARBOX = {"ratio": 5.6, "output_inertia_kg_m2": 6e-5}


@dataclass(frozen=True)
class Figure:
    """Median wall time of one solver for the run and its error against the reference."""

    name: str
    seconds: float
    times_real_time: float
    speed_error: float
    rtol: float | None


@dataclass(frozen=True)
class Run:
    """Rows of a log (time, duty at the row's end) and the stretches of one slope that a general solver integrates at a time."""

    time_s: Floats
    duty: Floats
    stretches: list[tuple[int, int]]


def staircase_run(seconds: int, seed: int) -> Run:
    """A staircase of forward duties with ramps at the trigger's slew rate, 1 kHz rows."""
    rng = np.random.default_rng(seed)
    steps = np.repeat(rng.uniform(0.3, 1.0, 2 * seconds), 500)
    duty = np.zeros(steps.size + 1)
    for row in range(1, duty.size):
        duty[row] = duty[row - 1] + np.clip(steps[row - 1] - duty[row - 1], -SLEW_PER_S * 1e-3, SLEW_PER_S * 1e-3)
    bends = np.flatnonzero(np.abs(np.diff(duty, 2)) > 1e-12) + 1
    knots = [0, *bends.tolist(), duty.size - 1]
    return Run(np.arange(duty.size) * 1e-3, duty, [(a, b) for a, b in zip(knots, knots[1:], strict=False) if b > a])


def peer_parameters(run: Run, first: int, last: int) -> Floats:
    """Parameters of peers._derivative for one stretch."""
    slope = (run.duty[last] - run.duty[first]) / (run.time_s[last] - run.time_s[first])
    inertia = MOTOR["inertia_kg_m2"] + GEARBOX["output_inertia_kg_m2"] / GEARBOX["ratio"] ** 2
    return np.array([BUS_V * run.duty[first], BUS_V * slope, run.time_s[first], MOTOR["resistance_ohm"], MOTOR["inductance_h"],
                     MOTOR["torque_constant_nm_per_a"], inertia, MOTOR["viscous_nm_s_per_rad"], MOTOR["coulomb_nm"]])


def peer_speed(run: Run, solver: Callable[[Floats, Floats, Floats, float], Floats], rtol: float) -> Floats:
    """Motor speed rad/s at the rows, (n,)."""
    speed = np.zeros(run.time_s.size)
    state = np.zeros(3)
    for first, last in run.stretches:
        states = solver(run.time_s[first : last + 1], state, peer_parameters(run, first, last), rtol)
        speed[first : last + 1] = states[:, 1]
        state = states[-1].copy()
    return speed


def own_parameters() -> Floats:
    """The tool of physics.md in the order of _core.PARAMETERS."""
    theta = np.array(_core.parameter_defaults())
    values = {"supply.voltage_v": BUS_V} | {f"motor.{k}": v for k, v in MOTOR.items()} | {f"gearbox.{k}": v for k, v in GEARBOX.items()}
    for name, value in values.items():
        theta[_core.PARAMETERS.index(name)] = value
    return theta


def own_speed(run: Run) -> Floats:
    """Motor speed rad/s at the rows by the plant, one lane, one thread."""
    log_input = _core.LogInput(run.time_s, "duty", run.duty, SLEW_PER_S)
    rows = _core.simulate_log(log_input, own_parameters()[None, :], np.array([0]), np.zeros((1, 3)), threads=1)
    return rows["speed_rad_s"][0]


def timed(work: Callable[[], Floats], repeats: int) -> float:
    """Median seconds of `repeats` runs after one warm-up."""
    work()
    seconds = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def measure_peer(name: str, solver: Callable[[Floats, Floats, Floats, float], Floats], run: Run, reference: Floats, repeats: int) -> Figure:
    """The loosest tolerance at which the peer reaches ACCURACY, and its time there."""
    for rtol in TOLERANCES:
        error = float(np.max(np.abs(peer_speed(run, solver, rtol) - reference)) / np.max(reference))
        if error <= ACCURACY:
            seconds = timed(lambda tol=rtol: peer_speed(run, solver, tol), repeats)
            return Figure(name, seconds, run.time_s[-1] / seconds, error, rtol)
    raise VgrooveError(f"{name} does not reach a speed error of {ACCURACY:g} at any tolerance down to {TOLERANCES[-1]:g}.")


def bench_speed(seconds: int = 10, seed: int = 1, repeats: int = 5) -> dict:
    """All figures of one run: {"run": ..., "figures": [...], "ratios": {peer: peer time / own time}}."""
    try:
        from vgroove.bench.peers import PEERS, scipy_lsoda
    except ImportError as error:
        raise VgrooveError(f"The peers are an optional extra ({error.name} is missing): run `make bench`.") from error
    run = staircase_run(seconds, seed)
    reference = peer_speed(run, scipy_lsoda, 1e-11)
    own_s = timed(lambda: own_speed(run), repeats)
    own_error = float(np.max(np.abs(own_speed(run) - reference)) / np.max(reference))
    figures = [Figure("vgroove simulate_log, one lane", own_s, run.time_s[-1] / own_s, own_error, None)]
    figures += [measure_peer(name, solver, run, reference, repeats) for name, solver in PEERS.items()]
    return {"run": f"{seconds} s staircase, 1 kHz rows, seed {seed}, accuracy {ACCURACY:g}, medians of {repeats}",
            "figures": [asdict(f) for f in figures], "ratios": {f.name: f.seconds / own_s for f in figures[1:]}}


def speed_table(figures: dict) -> Table:
    """The figures of bench_speed as a table."""
    table = Table("solver", "ms", "x real time", "speed error", "time / vgroove's", title=figures["run"])
    for figure in figures["figures"]:
        ratio = figures["ratios"].get(figure["name"], 1.0)
        cells = (f"{1e3 * figure['seconds']:.2f}", f"{figure['times_real_time']:,.0f}", f"{figure['speed_error']:.1e}", f"{ratio:.2f}")
        table.add_row(figure["name"], *cells)
    return table
