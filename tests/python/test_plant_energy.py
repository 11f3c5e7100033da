"""Energy balance of the drivetrain with every effect and load in turn: the work of the source is
the sum of losses, work on the load and stored energy.
"""

from __future__ import annotations

import numpy as np
import pytest

import plant_reference as ref
from test_plant_reference import EFFECTS, drive_log, theta_of
from vgroove import _core as core

BALANCE = 2e-6  # of the largest energy that flows
LOSSES = ("loss_bus", "loss_winding", "loss_friction", "loss_coupler")


def audit(
    tool: ref.Tool, log: ref.Log, start: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> dict[str, np.ndarray]:
    given = core.LogInput(
        log.time_s,
        log.kind,
        log.command,
        log.slew_per_s,
        log.supply_v,
        log.load_nm,
        log.coast,
        log.load_kind,
    )
    return core.audit_log(given, theta_of(tool), np.array([0]), np.array([start]))


def check_balance(energy: dict[str, np.ndarray]) -> None:
    spent = sum(energy[name] for name in LOSSES) + energy["work_load"]
    missing = energy["work_in"] - spent - (energy["stored"] - energy["stored"][0])
    assert np.max(np.abs(missing)) < BALANCE * np.max(np.abs(energy["work_in"])), np.max(
        np.abs(missing)
    )


@pytest.mark.parametrize("name", [None, *EFFECTS])
def test_balance(name: str | None) -> None:
    effects = {} if name is None else {name.split()[0]: EFFECTS[name]}
    energy = audit(ref.Tool(effects=effects), drive_log())
    check_balance(energy)
    assert energy["work_in"][-1] > 10.0


@pytest.mark.parametrize("name", ["coupler_compliance", "gear_backlash", "brush_drop"])
def test_balance_with_pendulum(name: str) -> None:
    check_balance(
        audit(
            ref.Tool(mass=0.49, length=0.1, effects={name: EFFECTS[name]}),
            drive_log(load_kind="pendulum"),
            (0.0, 20.0, 1.0),
        )
    )


@pytest.mark.parametrize("kind,factor", [("voltage_v", 18.0), ("current_a", 12.0)])
def test_balance_of_other_inputs(kind: str, factor: float) -> None:
    log = drive_log(kind=kind)
    log.command = factor * log.command
    log.slew_per_s = None
    log.coast = None
    check_balance(audit(ref.Tool(), log))


@pytest.mark.parametrize(
    "name",
    [None, "dead_time", "brush_drop", "cogging_torque", "gear_backlash", "coupler_compliance"],
)
def test_losses_never_give_energy_back(name: str | None) -> None:
    energy = audit(ref.Tool(effects={} if name is None else {name: EFFECTS[name]}), drive_log())
    for loss in LOSSES:
        assert np.min(np.diff(energy[loss])) >= -1e-9 * energy["work_in"].max(), loss


def test_undriven_tool_only_loses_energy() -> None:
    time_s = np.linspace(0.0, 2.0, 400)
    log = ref.Log(time_s, np.zeros_like(time_s), coast=np.ones_like(time_s), load_kind="pendulum")
    energy = audit(ref.Tool(mass=0.49, length=0.1, b=2e-5, tc=1e-3), log, (0.0, 0.0, 8.0))
    stored = energy["stored"]
    assert np.max(np.diff(stored)) < 1e-7
    assert stored[-1] < 0.9 * stored[0]
