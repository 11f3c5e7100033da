"""Keys of a rig file (docs/spec/gap.md, section 2): what each section accepts. Keys of effects and
loads come from the catalogue.
"""

from vgroove.gap.catalogue import BY_ID, LOADS
from vgroove.gap.catalogue.keys import Key, between, choice, flag, whole

JUDGED_COLUMNS = ("current_a", "supply_v", "speed_rpm", "position_rad")
# The ranges include motors from 0.3 W (5e-10 kg m2, 0.5 mN m/A, 100 ohm) to hundreds of kilowatts,
# and linear axes described by the same keys (EMPS, the electro-mechanical positioning system of
# tests/data/emps: 95 kg, 35 N/V). A value outside is impossible for a tool, or in another unit.
SECTIONS: dict[str, dict[str, Key]] = {
    "input": {
        "kind": choice("duty", "voltage_v", "current_a"),
        "slew_per_s": between(1e-4, 1e8).optional(),
        "bus": choice("modelled", "measured").optional(),
        "hold": choice("before", "after").optional(),
    },
    "supply": {
        "voltage_v": between(0.01, 5e3).optional(),
        "resistance_ohm": between(0, 1e3).optional(),
    },
    "bridge": {"pwm_hz": between(10, 1e7).optional()},
    "motor": {
        "resistance_ohm": between(1e-4, 1e4),
        "inductance_h": between(1e-8, 10),
        "torque_constant_nm_per_a": between(1e-5, 1e4),
        "inertia_kg_m2": between(1e-11, 1e4),
        "viscous_nm_s_per_rad": between(0, 1e5),
        "coulomb_nm": between(0, 1e5),
    },
    "gearbox": {"ratio": between(1e-4, 1e5), "output_inertia_kg_m2": between(0, 1e6)},
    "sensors": {
        "log_hz": between(0.1, 1e6).optional(),
        "current_noise_a": between(0, 1e5).optional(),
        "current_lsb_a": between(0, 1e5).optional(),
        "speed_noise_rpm": between(0, 1e5).optional(),
        "speed_lsb_rpm": between(0, 1e5).optional(),
        "hall_pulses_per_rev": whole(0, 1_000_000).optional(),
        "hall_timeout_s": between(1e-4, 1e3).optional(),
        "supply_noise_v": between(0, 1e4).optional(),
        "position_lsb_rad": between(0, 1e3).optional(),
        "clock_ppm": between(0.01, 1e5).optional(),
    },
    "clip": {column: between(1, 1e12).optional() for column in JUDGED_COLUMNS},
}

MECHANISMS: dict[str, dict[str, Key]] = {
    "none": {},
    "impact": {
        "hammer_inertia_kg_m2": between(1e-8, 1e2),
        "hammer_mass_kg": between(1e-4, 1e3),
        "groove_lead_m_per_rad": between(1e-5, 1),
        "groove_radius_m": between(1e-4, 1),
        "vertex_rad": between(0, 3),
        "travel_rad": between(1e-2, 100),
        "spring_preload_n": between(0, 1e6),
        "spring_rate_n_per_m": between(1, 1e9),
        "lug_count": whole(1, 100),
        "lug_height_m": between(1e-5, 1),
        "lug_radius_m": between(1e-4, 1),
        "lug_overlap_rad": between(1e-3, 6.3),
        "contact_stiffness_n_per_m": between(1e2, 1e12),
        "contact_damping_n_s_per_m": between(0, 1e8),
        "contact_ramp_m": between(1e-9, 0.1),
        "anvil_inertia_kg_m2": between(1e-9, 1e2),
        "hammer_start_rad": between(-100, 100).optional(),
        "hammer_groove_lead_m_per_rad": between(1e-5, 1).optional(),
        "hammer_groove_radius_m": between(1e-4, 1).optional(),
        "contact_exponent": between(1, 3).optional(),
        "friction_static": between(0, 2).optional(),
        "friction_kinetic": between(0, 2).optional(),
        "friction_speed_m_per_s": between(1e-6, 10).optional(),
        "arm_inertia_kg_m2": between(1e-6, 1e3).optional(),
        "arm_stiffness_nm_per_rad": between(0, 1e6).optional(),
        "arm_damping_nm_s_per_rad": between(0, 1e5).optional(),
    },
    "drill_driver": {
        "shaft_stiffness_nm_per_rad": between(1e-3, 1e9),
        "shaft_damping_nm_s_per_rad": between(1e-6, 1e6),
        "clutch_nm": between(1e-4, 1e5),
        "pulse": flag().optional(),
        "pulse_on_a": between(0, 1e5).optional(),
        "pulse_off_a": between(0, 1e5).optional(),
        "pulse_coast_s": between(1e-4, 10).optional(),
        "pulse_drive_s": between(1e-4, 10).optional(),
        "pulse_average_s": between(1e-4, 10).optional(),
    },
}

# Sections whose other keys depend on the value of their key `kind`.
KINDS: dict[str, dict[str, dict[str, Key]]] = {
    "mechanism": MECHANISMS,
    "load": {kind: load.rig_keys for kind, load in LOADS.items()},
}
EFFECTS: dict[str, dict[str, Key]] = {effect_id: e.rig_keys for effect_id, e in BY_ID.items()}
TOLERATED_SECTIONS = ("supply", "bridge", "motor", "gearbox")
TOLERANCE = between(0, 1)
