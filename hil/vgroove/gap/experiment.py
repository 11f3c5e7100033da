"""Which run to record next: the one of a menu whose physics separates the surviving rivals most."""

from typing import Any

from vgroove.gap.hypotheses import BY_ID
from vgroove.gap.search import Search
from vgroove.gap.verdict import Finding

# What each run excites; words are matched against what the rivals differ in.
MENU = {
    "staircase": ("both slow and fast steady speeds", ("speed",)),
    "reversal": ("the same speeds in both directions", ("direction",)),
    "coast-down": ("free deceleration with the bridge open: friction and inertia without the electrical side", ("friction", "inertia")),
    "stall pulse": ("a large current at standstill: resistance, current sensor and bus without back-EMF", ("current", "sensor_current")),
    "slow sweep": ("a slow passage through standstill: break-away and dead band", ("low_speed",)),
    "load steps": ("current changed at constant speed", ("load",)),
    "hold at heat": ("a long hold at high current after a rest", ("time",)),
    "fast ramps": ("steep command edges at several speeds", ("timing",)),
}
TRAITS = {
    "coulomb_friction": {"speed", "friction"}, "viscous_friction": {"speed", "friction"}, "quadratic_drag": {"speed", "friction"},
    "stribeck_friction": {"low_speed", "friction"}, "asymmetric_friction": {"direction", "friction"},
    "directional_viscous": {"direction", "speed", "friction"}, "cold_grease": {"time", "friction"}, "added_inertia": {"inertia"},
    "coupler_compliance": {"inertia", "timing"}, "transport_delay": {"timing"}, "clock_skew": {"timing"}, "speed_lag": {"timing"},
    "current_lag": {"timing"}, "current_gain": {"sensor_current", "current"}, "current_offset": {"sensor_current"},
    "torque_constant": {"load", "speed"}, "speed_gain": {"speed"}, "winding_resistance": {"current"}, "bridge_resistance": {"current"},
    "supply_resistance": {"current"}, "supply_droop": {"time", "current"}, "winding_heating": {"time", "current"},
    "brush_drop": {"current", "low_speed"}, "dead_time": {"current", "low_speed"}, "magnetic_saturation": {"load", "current"},
    "load_dependent_friction": {"load"}, "inductance": {"timing"},
}


# Pairs that the traits do not part: the run in which their equations differ most, and why.
PARTED = {
    frozenset({"brush_drop", "dead_time"}): (
        "staircase up to full duty", "dead time takes nothing at full duty, where nothing switches; brushes take as much as before"),
    frozenset({"added_inertia", "clock_skew"}): (
        "coast-down", "with the bridge open inertia stretches the decay; a clock also shifts the edges of a steady speed against stamps: "
        "hold one for some seconds before"),
    frozenset({"transport_delay", "speed_lag"}): ("fast ramps", "a delay shifts current and speed, a lag of the sensor the speed alone"),
    frozenset({"coupler_compliance", "added_inertia"}): ("fast ramps", "a spring rings after steep edges, a rigid inertia does not"),
    frozenset({"torque_constant", "speed_gain"}): ("stall pulse", "at standstill no speed sensor matters, the torque constant pulls"),
}


def propose(problem: Any, state: Search, finding: Finding) -> dict[str, str] | None:
    """Profile and reason when the verdict is ambiguous (the run that parts the rivals) or unlisted (the run that shows more of the gap)."""
    if finding.verdict == "ambiguous":
        rival = finding.rivals[0]
        pair = frozenset(set(finding.best.ids) ^ set(rival.ids))
        if pair in PARTED:
            return {"profile": PARTED[pair][0], "why": f"{PARTED[pair][1]}; there {words(finding.best.ids)} and {words(rival.ids)} part"}
        ours = set().union(*(TRAITS.get(i, set()) for i in finding.best.ids))
        theirs = set().union(*(TRAITS.get(i, set()) for i in rival.ids))
        differ = ours ^ theirs or ours
        name = max(MENU, key=lambda m: (len(differ & set(MENU[m][1])), -list(MENU).index(m)))
        return {"profile": name, "why": f"{MENU[name][0]}; there {words(finding.best.ids)} and {words(rival.ids)} part"}
    if finding.verdict == "unlisted":
        follows = finding.left.best_correlate
        name = {"time since start": "hold at heat", "heat": "hold at heat", "current": "load steps", "load": "load steps",
                "sign of speed": "reversal", "rate of command": "fast ramps"}.get(follows or "", "staircase")
        reason = f"what remains follows {follows}" if follows else "what remains follows none of the measured signals"
        return {"profile": name, "why": f"{reason}; {MENU[name][0]} show whether it repeats"}
    return None


def words(ids: tuple[str, ...]) -> str:
    """Names of effects in a sentence."""
    return " with ".join(BY_ID[i].id for i in ids)
