"""Setpoints of the controllers for a tool: the parameters of the board that belong to the motor
and the mechanism, computed from a rig.
"""

from vgroove.adapt.level_control import motor_of
from vgroove.adapt.level_scale import LevelScale
from vgroove.eeprom_image import parameter
from vgroove.errors import VgrooveError
from vgroove.reference.rigs import reference_rig
from vgroove.rig import Rig
from vgroove.units import RAD_S_PER_RPM

# Voltages at the motor and currents at which the reference tool impacts in step or just impacts.
VOLTAGES = ("sync_low_mv", "sync_high_mv", "screwing_least_mv", "vibration_hard_mv")
# Largest values that the numbers of controllers hold (docs/controllers/): rpm_per_a_q7 of blow.c,
# the resistance of vibration.c; least edges from lug to lug for `excess` of screwing.c
MOST_RPM_PER_A, MOST_VIBRATION_MOHM, LEAST_EDGES = 512.0, 511.0, 6.0
CURRENTS = ("sync_current_a", "vibration_surge_a")


def check_tool(rig: Rig) -> None:
    """VgrooveError for a rig without impact mechanism, or with Hall edges that no board reads."""
    if rig.mechanism["kind"] != "impact":
        raise VgrooveError(
            f"{rig.name or 'the rig'}: the controllers that are adapted are those of an impact "
            'driver; this needs [mechanism] kind = "impact"'
        )
    known, pulses = parameter("hall_pulses"), rig.sensors.get("hall_pulses_per_rev", 0)
    if not known.minimum <= pulses <= known.maximum:
        raise VgrooveError(
            f"{rig.name or 'the rig'}: the firmware reads {known.minimum} to {known.maximum} Hall "
            f"edges a turn of the motor, not sensors.hall_pulses_per_rev = {pulses:g}"
        )


def climb_share(rig: Rig) -> float:
    """Duty at which the motor holds the spring's preload, over that of the reference tool: F0 l /
    (N k) (R + Rs) / V, with the spindle's groove.
    """

    def duty(tool: Rig) -> float:
        k, resistance = motor_of(tool)
        torque = tool.mechanism["spring_preload_n"] * tool.mechanism["groove_lead_m_per_rad"]
        current = torque / tool.gearbox["ratio"] / k
        drop_v = current * (resistance + tool.value("supply.resistance_ohm"))
        return drop_v / tool.supply["voltage_v"]

    return duty(rig) / duty(reference_rig())


def setpoints(rig: Rig, motor_scale: LevelScale) -> dict[str, float]:
    """Physical values of the parameters by their names without suffix _qN, within their ranges.
    motor_scale: the tool's levels as voltages of its own motor.
    """
    return stored_values(needed_setpoints(rig, motor_scale))


def needed_setpoints(rig: Rig, motor_scale: LevelScale) -> dict[str, float]:
    """The values of setpoints() as the tool needs them, whether or not the board can hold them."""
    k, resistance = motor_of(rig)
    found = {
        "motor_mohm": 1000.0 * resistance,
        "motor_rpm_per_v": 1.0 / k / RAD_S_PER_RPM,
        "hall_pulses": rig.sensors["hall_pulses_per_rev"],
        "blow_turn": rig.gearbox["ratio"] / rig.mechanism["lug_count"],
        "vibration_approach": default_value("vibration_approach") * motor_scale.level,
        "vibration_climb": default_value("vibration_climb") * climb_share(rig),
    }
    found |= {name: default_value(name) * motor_scale.level for name in VOLTAGES}
    return found | {name: default_value(name) * motor_scale.current for name in CURRENTS}


def beyond_range(values: dict[str, float]) -> list[str]:
    """A sentence for each parameter of which the board cannot hold the value."""
    found = []
    for name, value in values.items():
        stored = stored_value(name, value)
        if abs(stored - value) > 2.0 ** -parameter(name).q:
            found.append(
                f"{name}: this tool needs {value:.4g} {parameter(name).unit}, the nearest value "
                f"that the board holds is {stored:.4g}"
            )
    return found


def beyond_controllers(values: dict[str, float]) -> list[str]:
    """A sentence for each of the values of needed_setpoints() that the board can store, but that
    exceeds the range of the numbers with which a controller computes.
    """
    found = []
    ohm, edges = values["motor_mohm"] / 1000.0, values["hall_pulses"] * values["blow_turn"]
    if ohm * values["motor_rpm_per_v"] >= MOST_RPM_PER_A:
        found.append(
            f"motor_mohm and motor_rpm_per_v: this tool loses {ohm * values['motor_rpm_per_v']:.0f}"
            f" rpm per A, blow detection without Hall edges counts at most {MOST_RPM_PER_A:g}"
        )
    if values["motor_mohm"] > MOST_VIBRATION_MOHM:
        found.append(
            f"motor_mohm: this tool needs {values['motor_mohm']:.0f} mohm, the low-vibration "
            f"controller counts at most {MOST_VIBRATION_MOHM:g}"
        )
    if edges < LEAST_EDGES:
        found.append(
            f"hall_pulses and blow_turn: {edges:.2g} edges from lug to lug, precise screwing needs "
            f"at least {LEAST_EDGES:g} to know the angle of a blow"
        )
    return found


def default_value(name: str) -> float:
    """Default of a parameter, in its physical unit (telemetry.Parameter.unit)."""
    found = parameter(name)
    return found.default / 2**found.q


def stored_values(needed: dict[str, float]) -> dict[str, float]:
    """stored_value() of each needed value by its name."""
    return {name: stored_value(name, value) for name, value in needed.items()}


def stored_value(name: str, value: float) -> float:
    """The value that the board holds, in the physical unit of the parameter: that of the nearest
    integer within the range.
    """
    found = parameter(name)
    raw = min(max(round(value * 2**found.q), found.minimum), found.maximum)
    return raw / 2**found.q
