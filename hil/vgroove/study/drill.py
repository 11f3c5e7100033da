"""The drill driver's runs for the studies: parameters from a rig, the design's parameter steps,
errors, limits of stability.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vgroove import _core
from vgroove.errors import VgrooveError
from vgroove.rig import Rig

# physics.md section 7: as built, more damping, more damping and a rounder friction law
PARAMETER_STEPS = {
    1: {"mechanism.shaft_damping_nm_s_per_rad": 0.02, "load.breakaway_rad_s": 0.1},
    2: {"mechanism.shaft_damping_nm_s_per_rad": 0.2, "load.breakaway_rad_s": 0.1},
    3: {"mechanism.shaft_damping_nm_s_per_rad": 2.0, "load.breakaway_rad_s": 5.0},
}
SLIPPING_CLUTCH_NM = 4.0  # the lowest setting of section 7: below the low gear's load
MODES: dict[str, dict[str, float]] = {
    "normal": {"mechanism.pulse": 0.0},
    "pulse": {"mechanism.pulse": 1.0},
    "slipping": {"mechanism.pulse": 0.0, "mechanism.clutch_nm": SLIPPING_CLUTCH_NM},
}
SOLVERS = {"euler": "Euler", "rk4": "RK4", "real_time": "real time"}
DURATION_S = 4.0
GRID_S = 5e-6  # of the reference's rows; every fixed step is a multiple
SPEEDS = ("speed_rad_s", "chuck_rad_s")


def parameters_of(rig: Rig) -> dict[str, float]:
    """The drill driver's parameters of a rig with mechanism drill_driver and load chuck;
    VgrooveError for another one.
    """
    parameters = rig.drill_parameters()
    if rig.supply.get("resistance_ohm", 0.0) != 0.0:
        raise VgrooveError(
            f"{rig.name or 'the rig'}: the solvers compared have no pack resistance: supply.resistance_ohm must be 0"
        )
    return parameters


@dataclass(frozen=True)
class Case:
    """One run of the studies: mode and parameter step on a tool."""

    mode: str
    step: int
    parameters: dict[str, float]

    @property
    def words(self) -> str:
        """For legends."""
        return f"{self.mode}, step {self.step}"

    @property
    def free_rad_s(self) -> dict[str, float]:
        """No-load speed of the motor and of the chuck: friction taken off."""
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
        Case(mode, step, parameters | PARAMETER_STEPS[step] | MODES[mode])
        for mode in modes or MODES
        for step in PARAMETER_STEPS
    ]


def reference(case: Case) -> dict[str, np.ndarray]:
    """Speeds of the reference on the grid, (n,) each; tolerance 1e-9."""
    return _core.simulate_drill(
        case.parameters,
        duration_s=DURATION_S,
        tolerance=1e-9,
        row_s=GRID_S,
        columns=["time_s", *SPEEDS],
    )


def fixed(case: Case, solver: str, step_s: float, timed: bool = False) -> dict[str, Any]:
    """A fixed-step run, a row every step."""
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
    """Largest difference over the run at its own instants, as a share of the no-load speed; None
    where it left every physical range.
    """
    if run["diverged_s"] is not None:
        return dict.fromkeys(SPEEDS)
    at = np.minimum(np.rint(run["time_s"] / GRID_S).astype(int), len(best["time_s"]) - 1)
    return {
        name: float(np.max(np.abs(run[name] - best[name][at]))) / case.free_rad_s[name]
        for name in SPEEDS
    }


def amplification(solver: str, z: np.ndarray) -> np.ndarray:
    """Growth per step of an explicit solver at z = step * eigenvalue."""
    return np.abs(1 + z) if solver == "euler" else np.abs(1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24)


def stability_limit_s(case: Case, solver: str) -> float:
    """The longest step with which an explicit solver damps every mode of the turning drive; the
    load's law counts only where it is flat.
    """
    states = [False] if case.mode != "slipping" else [False, True]
    eigenvalues = np.concatenate(
        [np.linalg.eigvals(_core.drill_jacobian(case.parameters, slips)) for slips in states]
    )
    for step_s in np.geomspace(1e-7, 1e-2, 5000):
        if np.any(amplification(solver, step_s * eigenvalues) > 1.0 + 1e-9):
            return float(step_s)
    return float("inf")
