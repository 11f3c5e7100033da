"""The kinds of load, one file each; everything that lists loads or joints reads LOADS."""

from . import chuck, disc_spring, free, hard_joint, locked, none, pendulum, torque, wood_screw

_MODULES = (none, torque, pendulum, locked, free, chuck, hard_joint, disc_spring, wood_screw)
LOADS = {module.LOAD.kind: module.LOAD for module in _MODULES}
JOINTS = tuple(kind for kind, load in LOADS.items() if load.joint)
DIAGNOSED_LOADS = tuple(kind for kind, load in LOADS.items() if load.diagnosed)
# Mechanism -> loads behind it of which logs can be diagnosed.
LOADS_BEHIND = {"none": DIAGNOSED_LOADS, "impact": (*DIAGNOSED_LOADS, *JOINTS)}


def load_parameters() -> dict[str, float]:
    """Parameters load.<name> of the plant with their defaults; ValueError where two loads give one
    name different defaults.
    """
    found: dict[str, float] = {}
    for load in LOADS.values():
        for name, default in load.flat.items():
            if found.setdefault(name, default) != default:
                raise ValueError(f"load.{name} has two defaults: {found[name]} and {default}")
    return found
