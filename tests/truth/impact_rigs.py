"""Impact tools of the cases: the nominal tool with its joint (rig.toml), the true tool, and the
parameters of the generator.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from rigs import sensor_lines, three_digits
from signals import Sensors

# The reference set of docs/spec/model.md, section 4
REFERENCE_VALUES = {
    "supply.voltage_v": 18.5,
    "supply.resistance_ohm": 0.10,
    "motor.resistance_ohm": 0.19,
    "motor.inductance_h": 1e-4,
    "motor.torque_constant_nm_per_a": 0.0109,
    "motor.inertia_kg_m2": 1.6e-5,
    "motor.viscous_nm_s_per_rad": 4.5e-6,
    "motor.coulomb_nm": 0.012,
    "gearbox.ratio": 5.6,
    "gearbox.output_inertia_kg_m2": 6e-6,
    "mechanism.hammer_inertia_kg_m2": 4.5e-5,
    "mechanism.hammer_mass_kg": 0.19,
    "mechanism.groove_lead_m_per_rad": 4.4e-3,
    "mechanism.groove_radius_m": 0.010,
    "mechanism.vertex_rad": 0.05,
    "mechanism.travel_rad": 2.8,
    "mechanism.spring_preload_n": 220.0,
    "mechanism.spring_rate_n_per_m": 29400.0,
    "mechanism.lug_count": 2,
    "mechanism.lug_height_m": 4.5e-3,
    "mechanism.lug_radius_m": 0.015,
    "mechanism.lug_overlap_rad": 1.0,
    "mechanism.contact_stiffness_n_per_m": 3e7,
    "mechanism.contact_damping_n_s_per_m": 2e3,
    "mechanism.contact_ramp_m": 1e-5,
    "mechanism.anvil_inertia_kg_m2": 1.2e-5,
}
# Keys of [load] by kind of joint, with values of docs/spec/model.md, section 6
JOINTS = {
    "hard_joint": {
        "stiffness_nm_per_rad": 3000.0,
        "damping_nm_s_per_rad": 0.3,
        "run_torque_nm": 0.3,
        "slip_slope_nm_per_rad": 700.0,
        "loosen_ratio": 0.75,
    },
    "disc_spring": {
        "stiffness_nm_per_rad": 3000.0,
        "damping_nm_s_per_rad": 0.3,
        "parallel": 4,
        "series": 42,
        "friction": 0.12,
        "from_turns": 4.0,
        "run_torque_nm": 0.3,
    },
    "wood_screw": {
        "stiffness_nm_per_rad": 100.0,
        "damping_nm_s_per_rad": 0.3,
        "start_nm": 0.5,
        "end_nm": 6.0,
        "turns": 36.0,
        "seat_nm": 12.0,
        "seat_deg": 90.0,
        "stripped_ratio": 0.35,
        "from_turns": 12.0,
        "loosen_ratio": 0.6,
    },
}
LOCKED_NM = 1000.0  # run torque of a hard joint that never slips
# start, end, turns, seat torque of M6, M8, M10
WOOD = ((0.5, 6.0, 36.0, 12.0), (0.9, 11.0, 26.0, 22.0), (1.5, 18.0, 21.0, 38.0))
# Largest relative change of a drawn tool against the reference set
VARIED = {
    "motor.resistance_ohm": 0.15,
    "motor.inductance_h": 0.15,
    "motor.torque_constant_nm_per_a": 0.05,
    "motor.inertia_kg_m2": 0.12,
    "motor.viscous_nm_s_per_rad": 0.15,
    "motor.coulomb_nm": 0.15,
    "mechanism.hammer_inertia_kg_m2": 0.08,
    "mechanism.hammer_mass_kg": 0.08,
    "mechanism.groove_lead_m_per_rad": 0.04,
    "mechanism.spring_preload_n": 0.08,
    "mechanism.spring_rate_n_per_m": 0.08,
    "mechanism.lug_height_m": 0.05,
    "mechanism.anvil_inertia_kg_m2": 0.1,
}
MOTOR_TOLERANCE = {
    "motor.resistance_ohm": 0.02,
    "motor.torque_constant_nm_per_a": 0.004,
    "motor.inertia_kg_m2": 0.02,
    "motor.viscous_nm_s_per_rad": 0.08,
    "motor.coulomb_nm": 0.05,
}
MECHANISM_TOLERANCE = {
    "mechanism.hammer_inertia_kg_m2": 0.01,
    "mechanism.spring_preload_n": 0.01,
    "mechanism.spring_rate_n_per_m": 0.01,
}
# Keys of [load] that may have a tolerance
LOOSE_KEYS = {
    "hard_joint": ("run_torque_nm", "slip_slope_nm_per_rad", "stiffness_nm_per_rad"),
    "disc_spring": ("friction", "from_turns", "stiffness_nm_per_rad"),
    "wood_screw": ("start_nm", "end_nm", "seat_nm", "stiffness_nm_per_rad"),
}
LOOSE_SIGMA = (0.1, 0.3)
# Effect -> keys of [load] that describe the same and therefore have no tolerance in its cases
SAME_AS = {
    "thread_friction": (
        "run_torque_nm",
        "slip_slope_nm_per_rad",
        "friction",
        "from_turns",
        "start_nm",
        "end_nm",
        "seat_nm",
    ),
    "joint_hysteresis": ("friction",),
    "joint_stiffness": ("stiffness_nm_per_rad",),
}
# Keys of a rig whose generator parameter has another name
RENAMED = {
    "supply.resistance_ohm": "supply_resistance_ohm",
    "load.stiffness_nm_per_rad": "joint_nm_per_rad",
    "load.damping_nm_s_per_rad": "joint_nm_s_per_rad",
}


@dataclass(frozen=True)
class ImpactRig:
    """A tool with its joint: `values` by dotted rig key, [load] included; `tolerance` maps keys to
    relative sigma; `bench` are the bench channels of the log.
    """

    name: str
    joint: str
    values: dict[str, float]
    slew_per_s: float | None = None
    pwm_hz: float = 20000.0
    sensors: Sensors = field(default_factory=Sensors)
    tolerance: dict[str, float] = field(default_factory=dict)
    bench: tuple[str, ...] = ()

    def __getitem__(self, key: str) -> float:
        return self.values[key]

    @property
    def locked(self) -> bool:
        return self.values.get("load.run_torque_nm", 0.0) >= LOCKED_NM

    def with_values(self, **changes: float) -> "ImpactRig":
        """The rig with values changed; section and key are joined by two underscores."""
        named = {key.replace("__", "."): value for key, value in changes.items()}
        return replace(self, values=self.values | named)


def joint_values(kind: str, **changes: float) -> dict[str, float]:
    """The values of [load] of a kind of joint by dotted key."""
    return {f"load.{key}": value for key, value in (JOINTS[kind] | changes).items()}


def reference_rig(kind: str, **changes: float) -> ImpactRig:
    """The reference tool on a joint; `changes` are keys of [load]."""
    values = REFERENCE_VALUES | joint_values(kind, **changes)
    return ImpactRig("impact driver, 18 V", kind, values)


def locked_rig() -> ImpactRig:
    """The reference tool on a joint that never slips."""
    return reference_rig("hard_joint", run_torque_nm=LOCKED_NM, slip_slope_nm_per_rad=0.0)


def draw_joint(name: str, rng: np.random.Generator) -> tuple[str, dict[str, float]]:
    """(kind, values of [load]) of a joint by its name: locked, hard_joint, disc_spring,
    wood_screw.
    """
    stiff = three_digits(3000.0 * rng.uniform(0.8, 1.4))
    damping = three_digits(rng.uniform(0.27, 0.4))
    common = {"stiffness_nm_per_rad": stiff, "damping_nm_s_per_rad": damping}
    if name == "locked":
        return "hard_joint", joint_values(
            "hard_joint", run_torque_nm=LOCKED_NM, slip_slope_nm_per_rad=0.0, **common
        )
    if name == "hard_joint":
        return name, joint_values(
            name,
            **common,
            run_torque_nm=three_digits(np.exp(rng.uniform(*np.log((0.3, 12.0))))),
            slip_slope_nm_per_rad=three_digits(np.exp(rng.uniform(*np.log((60.0, 700.0))))),
            loosen_ratio=three_digits(rng.uniform(0.7, 0.85)),
        )
    if name == "disc_spring":
        return name, joint_values(
            name,
            **common,
            parallel=int(rng.integers(3, 7)),
            series=int(rng.integers(36, 61)),
            friction=three_digits(rng.uniform(0.1, 0.14)),
            from_turns=three_digits(rng.uniform(3.0, 8.0)),
        )
    start, end, turns, seat = WOOD[int(rng.integers(len(WOOD)))]
    size = rng.uniform(0.9, 1.1, 3)
    return name, joint_values(
        name,
        stiffness_nm_per_rad=three_digits(100.0 * rng.uniform(0.8, 1.25)),
        damping_nm_s_per_rad=damping,
        start_nm=three_digits(start * size[0]),
        end_nm=three_digits(end * size[1]),
        turns=turns,
        seat_nm=three_digits(seat * size[2]),
        from_turns=three_digits(turns * rng.uniform(0.3, 0.75)),
    )


def tightened(rig: ImpactRig, rng: np.random.Generator) -> ImpactRig:
    """The rig with a joint that is tight enough to be loosened for a second or two."""
    turns = {
        "disc_spring": rng.uniform(11.0, 17.0),
        "wood_screw": rig.values.get("load.turns", 0.0) * rng.uniform(0.75, 0.98),
    }
    if rig.joint not in turns:
        return rig
    return rig.with_values(load__from_turns=three_digits(float(turns[rig.joint])))


def draw_impact_rig(joint: str, rng: np.random.Generator, **changes: object) -> ImpactRig:
    """The reference tool with its values changed, at 16.5 to 20 V, on a drawn joint."""
    values = dict(REFERENCE_VALUES)
    for key, most in VARIED.items():
        values[key] = three_digits(values[key] * (1.0 + most * float(rng.uniform(-1.0, 1.0))))
    values["supply.voltage_v"] = round(float(rng.uniform(16.5, 20.0)), 1)
    values["supply.resistance_ohm"] = three_digits(0.1 * float(rng.uniform(0.6, 1.4)))
    kind, load = draw_joint(joint, rng)
    return ImpactRig("impact driver, 18 V", kind, values | load, **changes)


def draw_tolerance(
    rig: ImpactRig, tool: bool, joint: bool, rng: np.random.Generator
) -> dict[str, float]:
    """[tolerance] of a rig whose tool or joint is not known exactly: of the joint's keys each in
    two thirds of the cases, at least one.
    """
    found: dict[str, float] = {}
    if tool:
        found |= MOTOR_TOLERANCE | (MECHANISM_TOLERANCE if rng.uniform() < 0.5 else {})
    if joint:
        keys = ("stiffness_nm_per_rad",) if rig.locked else LOOSE_KEYS[rig.joint]
        sure = int(rng.integers(len(keys)))
        loose = [k for n, k in enumerate(keys) if n == sure or rng.uniform() < 2.0 / 3.0]
        found |= {f"load.{key}": round(float(rng.uniform(*LOOSE_SIGMA)), 2) for key in loose}
    return found


def without_same(tolerance: dict[str, float], ids: list[str]) -> dict[str, float]:
    """[tolerance] without the keys that describe the same as one of the effects."""
    same = {f"load.{key}" for i in ids for key in SAME_AS.get(i, ())}
    return {key: sigma for key, sigma in tolerance.items() if key not in same}


def draw_impact_tool(rig: ImpactRig, rng: np.random.Generator) -> ImpactRig:
    """The true tool: the rig with values off by its tolerances, at most two sigma."""
    real = {
        key: rig[key] * (1.0 + sigma * float(np.clip(rng.standard_normal(), -2.0, 2.0)))
        for key, sigma in rig.tolerance.items()
    }
    return replace(rig, values=rig.values | real)


def impact_params(rig: ImpactRig) -> dict[str, float]:
    """Parameters of impact.hpp for a rig, effects off; the joint's slip torque is not among
    them.
    """
    named = (*RENAMED, *(key for key in rig.values if not key.startswith("load.")))
    params = {RENAMED.get(key, key.split(".")[1]): float(rig[key]) for key in named}
    params["pwm_hz"] = rig.pwm_hz
    params["hall_edges"] = float(rig.sensors.hall_pulses_per_rev)
    params["hall_jitter_s"] = rig.sensors.edge_jitter_s
    return params


def section_lines(rig: ImpactRig, section: str) -> list[str]:
    """The lines of a section of the rig."""
    lines = [f"[{section}]"]
    if section == "mechanism":
        lines.append('kind = "impact"')
    if section == "load":
        lines.append(f'kind = "{rig.joint}"')
    return lines + [
        f"{key.split('.')[1]} = {value!r}"
        for key, value in rig.values.items()
        if key.startswith(f"{section}.")
    ]


def impact_toml(rig: ImpactRig) -> str:
    """The text of rig.toml (docs/spec/gap.md, section 2)."""
    lines = ['schema = "vgroove.rig/1"', f'name = "{rig.name}"', "[input]", 'kind = "duty"']
    lines += [f"slew_per_s = {rig.slew_per_s}"] if rig.slew_per_s else []
    lines += section_lines(rig, "supply") + ["[bridge]", f"pwm_hz = {rig.pwm_hz}"]
    for section in ("motor", "gearbox", "mechanism", "load"):
        lines += section_lines(rig, section)
    lines += sensor_lines(rig.sensors)
    if rig.tolerance:
        lines += ["[tolerance]", *(f'"{key}" = {value}' for key, value in rig.tolerance.items())]
    return "\n".join(lines) + "\n"
