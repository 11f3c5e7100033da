"""The joints on which studies and benches run the impact tool: one entry a joint."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

_STIFF = {"stiffness_nm_per_rad": 3000, "damping_nm_s_per_rad": 0.3}
_HARD = {"kind": "hard_joint", **_STIFF, "loosen_ratio": 0.75}
_WOOD = {
    "kind": "wood_screw",
    "stiffness_nm_per_rad": 100,
    "damping_nm_s_per_rad": 0.3,
    "seat_deg": 90,
    "stripped_ratio": 0.35,
    "loosen_ratio": 0.6,
    "from_turns": 12,
}


@dataclass(frozen=True)
class Joint:
    """A joint: `load` is its section [load] of a rig (SI units), `title` names it in figures,
    `short` in tables.
    """

    load: Mapping[str, Any]
    title: str
    short: str


# Values of docs/spec/model.md, sections 4 (locked, hard and slipping joints) and 6 (disc springs,
# lag screws).
REFERENCE_JOINTS: dict[str, Joint] = {
    "locked": Joint({"kind": "locked", **_STIFF}, "locked", "locked"),
    "hard_joint": Joint(
        {**_HARD, "run_torque_nm": 0.3, "slip_slope_nm_per_rad": 700},
        "hard joint, 700 N m/rad",
        "hard 700",
    ),
    "slip_60": Joint(
        {**_HARD, "run_torque_nm": 60, "slip_slope_nm_per_rad": 0}, "slips at 60 N m", "slip 60"
    ),
    "slip_6": Joint(
        {**_HARD, "run_torque_nm": 6, "slip_slope_nm_per_rad": 0}, "slips at 6 N m", "slip 6"
    ),
    "disc_spring": Joint(
        {
            "kind": "disc_spring",
            **_STIFF,
            "parallel": 4,
            "series": 42,
            "friction": 0.12,
            "from_turns": 4,
            "run_torque_nm": 0.3,
        },
        "disc springs, n = 4, i = 42",
        "disc springs",
    ),
    "m6": Joint(
        {**_WOOD, "start_nm": 0.5, "end_nm": 6.0, "turns": 36, "seat_nm": 12.0},
        "lag screw M6",
        "M6",
    ),
    "m8": Joint(
        {**_WOOD, "start_nm": 0.9, "end_nm": 11.0, "turns": 26, "seat_nm": 22.0},
        "lag screw M8",
        "M8",
    ),
    "m10": Joint(
        {**_WOOD, "start_nm": 1.5, "end_nm": 18.0, "turns": 21, "seat_nm": 38.0},
        "lag screw M10",
        "M10",
    ),
}
