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
CURRENTS = ("sync_current_a", "vibration_surge_a")


def check_tool(rig: Rig) -> None:
    """VgrooveError for a rig without impact mechanism."""
    if rig.mechanism["kind"] != "impact":
        raise VgrooveError(
            f"{rig.name or 'the rig'}: the controllers that are adapted are those of an impact "
            'driver; this needs [mechanism] kind = "impact"'
        )


def climb_share(rig: Rig) -> float:
    """Duty at which the motor holds the spring's preload, over that of the reference tool."""

    def duty(tool: Rig) -> float:
        k, resistance = motor_of(tool)
        current = tool.mechanism["spring_preload_n"] / k
        return current * (resistance + tool.value("supply.resistance_ohm"))

    return duty(rig) / duty(reference_rig())


def setpoints(rig: Rig, motor_scale: LevelScale) -> dict[str, float]:
    """Physical values of the parameters by their names without suffix _qN, within their ranges.
    motor_scale: the tool's levels as voltages of its own motor.
    """
    needed = needed_setpoints(rig, motor_scale)
    return {name: stored_value(name, value) for name, value in needed.items()}


def needed_setpoints(rig: Rig, motor_scale: LevelScale) -> dict[str, float]:
    """The values of setpoints() as the tool needs them, whether or not the board can hold them."""
    k, resistance = motor_of(rig)
    found = {
        "motor_mohm": 1000.0 * resistance,
        "motor_rpm_per_v": 1.0 / k / RAD_S_PER_RPM,
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


def default_value(name: str) -> float:
    """Default of a parameter, in its physical unit (telemetry.Parameter.unit)."""
    found = parameter(name)
    return found.default / 2**found.q


def stored_value(name: str, value: float) -> float:
    """The value that the board holds, in the physical unit of the parameter: that of the nearest
    integer within the range.
    """
    found = parameter(name)
    raw = min(max(round(value * 2**found.q), found.minimum), found.maximum)
    return raw / 2**found.q
