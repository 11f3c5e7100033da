"""The drill driver's runs for the studies: parameters of a rig, modes and parameter steps (sets of
parameters that make the model less stiff), errors, limits of stability.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.rig import Rig

# docs/spec/model.md, section 7: as built; more damping; more damping and a less steep friction law
PARAMETER_STEPS = {
    1: {"mechanism.shaft_damping_nm_s_per_rad": 0.02, "load.breakaway_rad_s": 0.1},
    2: {"mechanism.shaft_damping_nm_s_per_rad": 0.2, "load.breakaway_rad_s": 0.1},
    3: {"mechanism.shaft_damping_nm_s_per_rad": 2.0, "load.breakaway_rad_s": 5.0},
}
# the lowest setting of docs/spec/model.md, section 7, below the load in low gear
SLIPPING_CLUTCH_NM = 4.0


@dataclass(frozen=True)
class Mode:
    """A mode of the drill driver: its title in figures, and the parameters that it sets."""

    title: str
    values: dict[str, float]


MODES = {
    "normal": Mode("normal mode", {"mechanism.pulse": 0.0}),
    "pulse": Mode("pulse mode", {"mechanism.pulse": 1.0}),
    "slipping": Mode(
        "normal mode, clutch set to 4 N m: slips under the load",
        {"mechanism.pulse": 0.0, "mechanism.clutch_nm": SLIPPING_CLUTCH_NM},
    ),
}
SOLVERS = {"euler": "Euler", "rk4": "RK4", "real_time": "real time"}
DURATION_S = 4.0
GRID_S = 5e-6  # interval of the reference's rows; every fixed step is a multiple of it
REFERENCE_TOLERANCE = 1e-9
SPEEDS = ("speed_rad_s", "chuck_rad_s")
ROUNDING = 1e-9  # by which an amplification may exceed 1


def parameters_of(rig: Rig) -> dict[str, float]:
    """Parameters of a rig with mechanism drill_driver and load chuck, by dotted key.

    Raises VgrooveError for another rig, and for a pack resistance, which the solvers lack.
    """
    parameters = rig.drill_parameters()
    if rig.supply.get("resistance_ohm", 0.0) != 0.0:
        raise VgrooveError(
            f"{rig.name or 'the rig'}: the solvers compared have no pack resistance: "
            "supply.resistance_ohm must be 0"
        )
    return parameters


@dataclass(frozen=True)
class Case:
    """One run of the studies: a mode and a parameter step on a tool."""

    mode: str
    parameter_step: int
    parameters: dict[str, float]

    @property
    def title(self) -> str:
        """Name of the case in progress texts."""
        return f"{self.mode}, parameter step {self.parameter_step}"

    @property
    def free_rad_s(self) -> dict[str, float]:
        """No-load speed of the motor and of the chuck, the motor's friction deducted."""
        p = self.parameters
        r, k = p["motor.resistance_ohm"], p["motor.torque_constant_nm_per_a"]
        volts = p["supply.voltage_v"] * abs(p["drive.duty"])
        motor = (k * volts - r * p["motor.coulomb_nm"]) / (
            k * k + r * p["motor.viscous_nm_s_per_rad"]
        )
        return {"speed_rad_s": motor, "chuck_rad_s": motor / p["gearbox.ratio"]}


def cases(parameters: dict[str, float], modes: list[str] | None = None) -> list[Case]:
    """Every mode in each of the three parameter steps."""
    return [
        Case(mode, step, parameters | PARAMETER_STEPS[step] | MODES[mode].values)
        for mode in modes or MODES
        for step in PARAMETER_STEPS
    ]


def reference(case: Case) -> dict[str, np.ndarray]:
    """Speeds of the reference solution at multiples of GRID_S, (n,) each."""
    return _core.simulate_drill(
        case.parameters,
        duration_s=DURATION_S,
        tolerance=REFERENCE_TOLERANCE,
        row_s=GRID_S,
        columns=["time_s", *SPEEDS],
    )


def fixed(case: Case, solver: str, step_s: float, timed: bool = False) -> dict[str, Any]:
    """A fixed-step run with one row a step; `timed` measures the execution time of each."""
    return _core.simulate_drill(
        case.parameters,
        solver,
        duration_s=DURATION_S,
        step_s=step_s,
        timed=timed,
        columns=["time_s", *SPEEDS],
    )


def speed_errors(
    case: Case, run: dict[str, Any], best: dict[str, np.ndarray]
) -> dict[str, float | None]:
    """Largest difference of a run from the reference `best` at the run's own instants, as a share
    of the no-load speed; None where the run diverged.
    """
    if run["diverged_s"] is not None:
        return dict.fromkeys(SPEEDS)
    at = np.minimum(np.rint(run["time_s"] / GRID_S).astype(int), len(best["time_s"]) - 1)
    return {
        name: float(np.max(np.abs(run[name] - best[name][at]))) / case.free_rad_s[name]
        for name in SPEEDS
    }


def amplification(solver: str, z: np.ndarray) -> np.ndarray:
    """Magnitude of the stability function of Euler or of RK4 at z = step * eigenvalue, (n,)."""
    return np.abs(1 + z) if solver == "euler" else np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24)


def stability_limit_s(case: Case, solver: str) -> float:
    """The longest step in s with which an explicit solver damps every mode of the turning drive.

    The eigenvalues are those where the load's friction law is flat.
    """
    states = [False] if case.mode != "slipping" else [False, True]
    eigenvalues = np.concatenate(
        [np.linalg.eigvals(_core.drill_jacobian(case.parameters, slips)) for slips in states]
    )
    for step_s in np.geomspace(1e-7, 1e-2, 5000):
        if np.any(amplification(solver, step_s * eigenvalues) > 1.0 + ROUNDING):
            return float(step_s)
    return float("inf")
