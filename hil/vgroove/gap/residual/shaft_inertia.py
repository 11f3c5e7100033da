"""Inertia at the motor's shaft as a function of the plant's parameters."""

from collections.abc import Callable
from typing import TypeVar

Number = TypeVar("Number")  # a float, or an array over parameter sets


def shaft_inertia(value: Callable[[str], Number], load_kind: str) -> Number:
    """Inertia in kg m2 of rotor, added inertia, gearbox output and a pendulum, referred to the
    motor's shaft. value: of a parameter by its name; load_kind: of the rig's [load].
    """
    output = value("gearbox.output_inertia_kg_m2")
    if load_kind == "pendulum":
        output = output + value("load.mass_kg") * value("load.length_m") ** 2
    rotor = value("motor.inertia_kg_m2") + value("effects.added_inertia.kg_m2")
    return rotor + output / value("gearbox.ratio") ** 2
