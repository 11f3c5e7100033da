"""Drives of the native firmware on drawn tools of the independent simulator (tests/proof)."""

import sys
from pathlib import Path

import pytest

PROOF = Path(__file__).resolve().parents[1] / "proof"
if str(PROOF) not in sys.path:
    sys.path.insert(0, str(PROOF))

import diagnosed_tools as chain  # noqa: E402

from vgroove.reference.rigs import reference_rig  # noqa: E402

NOMINAL = chain.TrueTool(0, {**dict.fromkeys(chain.KEYS, 1.0), "groove_friction": 0.0})
CELL = {
    "target_nm": 90.4,
    "slope": 250.0,
    "supply_v": 18.5,
    "trigger": 0.95,
    "start_rad": -0.8,
    "joint_friction": 1.0,
    "rough_share": 0.0,
    "rough_at": 0.5,
}


@pytest.mark.parametrize("friction", [0.92, 1.0, 1.08])
def test_the_nominal_tool_reaches_its_target_with_the_firmware_of_the_reference_tool(
    friction: float,
) -> None:
    row = chain.drive(NOMINAL, {**CELL, "joint_friction": friction}, 3, ({}, None))
    assert row["target_nm"] == 90.0 and row["reason"] == "reached"
    assert abs(row["error"]) < 0.03


def test_a_larger_torque_constant_is_an_error_that_the_board_does_not_see() -> None:
    strong = {**NOMINAL.shares, "motor.torque_constant_nm_per_a": 1.05}
    row = chain.drive(chain.TrueTool(0, strong), CELL, 3, ({}, None))
    assert abs(row["error"]) > 0.03


def test_tools_are_drawn_within_their_share_and_each_half_of_a_range_has_half_of_them() -> None:
    tools = chain.drawn_tools(8)
    for key in chain.KEYS:
        shares = [tool.shares[key] for tool in tools]
        assert all(0.95 <= share <= 1.05 for share in shares)
        assert sum(share > 1.0 for share in shares) == 4


def test_the_true_rig_and_the_simulator_have_the_same_values() -> None:
    tool = chain.drawn_tools(8)[3]
    rig, params = tool.true_rig(reference_rig()), chain.impact_params(tool.on(chain.RUNS["locked"]))
    for key in chain.KEYS:
        name = {"supply.resistance_ohm": "supply_resistance_ohm"}.get(key, key.split(".")[1])
        assert params[name] == pytest.approx(rig.value(key))
