"""Tools of the cases: the nominal tool (rig.toml), and the generator's parameters of the same
tool.
"""

from dataclasses import asdict, dataclass, field, replace

import numpy as np
from signals import Sensors


@dataclass(frozen=True)
class Rig:
    """The nominal tool, SI units; `tolerance` maps rig keys to relative sigma."""

    name: str
    voltage_v: float
    resistance_ohm: float
    inductance_h: float
    torque_constant_nm_per_a: float
    inertia_kg_m2: float
    viscous_nm_s_per_rad: float
    coulomb_nm: float
    ratio: float
    output_inertia_kg_m2: float
    supply_resistance_ohm: float = 0.0
    pwm_hz: float = 20000.0
    slew_per_s: float | None = 6.0
    input: str = "duty"  # duty, voltage_v or current_a
    bus: str = "modelled"  # modelled, measured (the column drives the model) or absent (no column)
    load: str = "none"
    pendulum_mass_kg: float = 0.0
    pendulum_length_m: float = 0.0
    sensors: Sensors = field(default_factory=Sensors)
    tolerance: dict[str, float] = field(default_factory=dict)


# Classes of power tools; values estimated from the no-load speed, stall current and rotor mass in
# manufacturers' catalogues.
TOOLS = (
    Rig("compact drill, 18 V", 18.0, 0.082, 6.2e-5, 0.0076, 9.5e-6, 3.1e-6, 0.0085, 11.0, 8e-5),
    Rig("impact driver, 18 V", 18.0, 0.17, 9e-5, 0.0102, 1.5e-5, 4e-6, 0.0105, 6.2, 5.5e-5),
    Rig("impact wrench, 36 V", 36.0, 0.14, 1.9e-4, 0.0215, 4.6e-5, 1.2e-5, 0.034, 5.4, 2.4e-4),
    Rig("screwdriver, 12 V", 12.0, 0.41, 2.1e-4, 0.0079, 5.2e-6, 1.7e-6, 0.0052, 16.0, 3.5e-5),
    Rig(
        "ratchet, 14.4 V",
        14.4,
        0.28,
        1.5e-4,
        0.0094,
        9e-6,
        2.6e-6,
        0.0075,
        21.0,
        9e-5,
        supply_resistance_ohm=0.02,
    ),
)
# The reference set of docs/spec/model.md, section 4, without its impact mechanism: the demo's tool.
REFERENCE = Rig(
    "impact driver, 18 V",
    18.0,
    0.19,
    1e-4,
    0.0109,
    1.6e-5,
    4.5e-6,
    0.012,
    5.6,
    6e-5,
    slew_per_s=None,
)
TOLERANCE = {
    "motor.resistance_ohm": 0.02,
    "motor.torque_constant_nm_per_a": 0.004,
    "motor.inertia_kg_m2": 0.02,
    "motor.viscous_nm_s_per_rad": 0.08,
    "motor.coulomb_nm": 0.05,
}
VARIED = (
    "resistance_ohm",
    "inductance_h",
    "torque_constant_nm_per_a",
    "inertia_kg_m2",
    "viscous_nm_s_per_rad",
    "coulomb_nm",
)


def three_digits(value: float) -> float:
    return float(f"{value:.3g}")


def draw_rig(rng: np.random.Generator, **changes: object) -> Rig:
    """One of TOOLS with its values changed by -18 to +20 % and rounded to three digits."""
    base = TOOLS[int(rng.integers(len(TOOLS)))]
    moved = {
        key: three_digits(getattr(base, key) * float(rng.uniform(0.82, 1.2))) for key in VARIED
    }
    return replace(base, **moved, **changes)


def draw_tool(rig: Rig, rng: np.random.Generator) -> Rig:
    """The true tool: the rig with values off by its tolerances, at most two sigma."""
    real = {}
    for key, sigma in rig.tolerance.items():
        name = key.split(".")[1]
        real[name] = getattr(rig, name) * (
            1.0 + sigma * float(np.clip(rng.standard_normal(), -2.0, 2.0))
        )
    return replace(rig, **real)


def generator_params(rig: Rig) -> dict[str, float]:
    """Parameters of params.hpp for a rig, effects off."""
    same = (
        "voltage_v",
        "supply_resistance_ohm",
        "pwm_hz",
        "ratio",
        "output_inertia_kg_m2",
        "pendulum_mass_kg",
        "pendulum_length_m",
    )
    params = {name: float(getattr(rig, name)) for name in (*same, *VARIED)}
    params["hall_edges"] = float(rig.sensors.hall_pulses_per_rev)
    params["hall_jitter_s"] = rig.sensors.edge_jitter_s
    return params


def input_lines(rig: Rig) -> list[str]:
    """Section [input]; the slew rate is in the unit of the input."""
    volts = rig.voltage_v if rig.input == "voltage_v" else 1.0
    lines = ["[input]", f'kind = "{rig.input}"']
    if rig.slew_per_s and rig.input != "current_a":
        lines.append(f"slew_per_s = {rig.slew_per_s * volts}")
    return lines + (['bus = "measured"'] if rig.bus == "measured" else [])


def load_lines(rig: Rig) -> list[str]:
    """Section [load]."""
    lines = ["[load]", f'kind = "{rig.load}"']
    if rig.load == "pendulum":
        lines += [f"mass_kg = {rig.pendulum_mass_kg}", f"length_m = {rig.pendulum_length_m}"]
    return lines


def sensor_lines(s: Sensors) -> list[str]:
    """Section [sensors]."""
    lines = [
        "[sensors]",
        f"log_hz = {s.log_hz:g}",
        f"current_noise_a = {s.current_noise_a}",
        f"current_lsb_a = {s.current_lsb_a}",
        f"speed_lsb_rpm = {s.speed_lsb_rpm}",
        f"hall_pulses_per_rev = {s.hall_pulses_per_rev}",
        f"hall_timeout_s = {s.hall_timeout_s}",
        f"supply_noise_v = {s.supply_noise_v}",
    ]
    lines += [f"speed_noise_rpm = {s.speed_noise_rpm}"] if s.speed_noise_rpm else []
    return lines + ([f"position_lsb_rad = {s.position_lsb_rad!r}"] if s.position_lsb_rad else [])


def toml(rig: Rig) -> str:
    """The text of rig.toml (docs/spec/gap.md, section 2)."""
    d = asdict(rig)
    tolerance = [f'"{key}" = {value}' for key, value in rig.tolerance.items()]
    lines = [
        'schema = "vgroove.rig/1"',
        f'name = "{rig.name}"',
        *input_lines(rig),
        "[supply]",
        f"voltage_v = {rig.voltage_v}",
        f"resistance_ohm = {rig.supply_resistance_ohm}",
        "[bridge]",
        f"pwm_hz = {rig.pwm_hz}",
        "[motor]",
        *(f"{key} = {d[key]!r}" for key in VARIED),
        "[gearbox]",
        f"ratio = {rig.ratio}",
        f"output_inertia_kg_m2 = {rig.output_inertia_kg_m2!r}",
        "[mechanism]",
        'kind = "none"',
        *load_lines(rig),
        *sensor_lines(rig.sensors),
        *(["[tolerance]", *tolerance] if tolerance else []),
    ]
    return "\n".join(lines) + "\n"
