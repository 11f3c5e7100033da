"""`vgroove study load`: torque over angle of the joints, disc springs, tightening factor, the
effect of a torque sensor, motion at two duties.
"""

from typing import Any

from vgroove.html_page import LEAST_SHOWN, shown
from vgroove.progress import Tick
from vgroove.result_files import Report
from vgroove.rig import Rig
from vgroove.study.coupler import coupler_picture, coupler_pulse, coupler_rows, coupler_table
from vgroove.study.disc_springs import (
    disc_table,
    simulated_stack,
    stack_figures,
    stack_picture,
)
from vgroove.study.motion import motion, motion_picture, motion_row, motion_table
from vgroove.study.tightening import bolt_table, reached_table, tightening
from vgroove.study.torque_angle import (
    CURVES,
    curve,
    curve_picture,
    curve_row,
    joint_table,
    other_picture,
)

LOAD_TICKS = 5  # steps of the progress bar
DUTIES = (0.5, 1.0)


def load_study(rig: Rig, duration_s: float, tick: Tick) -> Report:
    """Run the study on the tool `rig`, duration_s each run; `tick` is called LOAD_TICKS times."""
    curves = {joint: curve(rig, joint) for joint in CURVES}
    rows = [curve_row(joint, found) for joint, found in curves.items()]
    tick("torque over angle")
    stack = simulated_stack(rig, duration_s)
    tick("disc springs")
    bolt = tightening(rig, duration_s)
    tick("tightening factor")
    coupler, pulses = coupler_rows(rig, duration_s), coupler_pulse(rig, duration_s)
    tick("coupler")
    motions = {duty: motion(rig, "hard_joint", duty, duration_s) for duty in DUTIES}
    tick("motion at two duties")
    figures = stack_figures(stack)
    data = {
        "rig": rig.name,
        "duration_s": duration_s,
        "joints": rows,
        "disc_springs": figures,
        "bolt": bolt,
        "coupler": coupler,
        "motion": [motion_row(duty, m) for duty, m in motions.items()],
    }
    tables = [
        joint_table(rows),
        disc_table(figures),
        bolt_table(bolt),
        reached_table(bolt),
        coupler_table(coupler),
        motion_table(data["motion"]),
    ]
    pictures = [
        curve_picture(curves),
        other_picture(),
        stack_picture(stack),
        coupler_picture(pulses),
        motion_picture(motions),
    ]
    return Report(
        "load",
        f"Loads of the {rig.name or 'impact driver'}",
        load_lines(figures, bolt, coupler),
        tables,
        pictures,
        data,
    )


def load_lines(
    figures: dict[str, float], bolt: dict[str, Any], coupler: list[dict[str, Any]]
) -> list[str]:
    """The findings in sentences."""
    peak = {(r["load"], r["coupler"]): r for r in coupler}
    plain, coupled = peak["locked", "without"], peak["locked", "with"]
    difference = shown(max(figures["largest_difference_percent"], LEAST_SHOWN))
    lines = [
        f"The simulated stack of disc springs lies within {difference} % of the calculation; one "
        f"spring at 0.75 h0 carries {figures['single_at_0.75_n']:.0f} N.",
        f"Tightening factor {bolt['factor']:.2f}: {bolt['factor_friction']:.2f} from friction 0.10 "
        f"to 0.14, {bolt['factor_supply']:.2f} from a supply of 17 to 20 V.",
    ]
    if plain["torque_peak_nm"] and coupled["torque_peak_nm"]:
        lines.append(
            "With the coupler the peaks measured on the locked joint are "
            f"{coupled['torque_peak_nm']:.0f} instead of {plain['torque_peak_nm']:.0f} N m."
        )
    return lines
