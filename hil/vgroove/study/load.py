"""`vgroove study load`: torque over angle of the joints, disc springs, bolt, the coupler's effect
on the torque, motion at two duties.
"""

from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from vgroove import _core
from vgroove.page import LEAST_SHOWN, Picture, Table, shown, style, thin
from vgroove.rig import Rig
from vgroove.study.command import Tick
from vgroove.study.impact_runs import (
    JOINT_SHORT,
    JOINT_WORDS,
    JOINTS,
    blow_figures,
    simulate,
    with_joint,
)
from vgroove.study.report import Study

CURVES = ("hard_joint", "disc_spring", "m6", "m8", "m10")
# from the start of the log
CURVE_TURNS = {"hard_joint": 0.15, "disc_spring": 20.1, "m6": 25.5, "m8": 15.5, "m10": 10.5}
COLOURS = ("#30343b", "#d1495b", "#edae49", "#00798c", "#66a182")
DUTIES = (0.5, 1.0)
PENDULUM = {"mass_kg": 0.49, "length_m": 0.1}  # gap contract, section 2
# physics.md section 3, sizes E
FREE = {"coulomb_nm": 0.5, "breakaway_nm": 0.6, "w_brk": 5.0, "threshold": 0.5, "decay": 0.3}
# physics.md section 6
YOUNG_PA, POISSON = 206e9, 0.3
DISC = {"outer_m": 40e-3, "inner_m": 20.4e-3, "thickness_m": 1.5e-3, "cone_m": 1.15e-3}
PARALLEL, SERIES = 4, 42
STACK_STARTS = (0.0, 5.0, 10.0, 15.0, 20.0)  # turns of the bolt at which a run begins
PITCH_M, FLANK_M, HEAD_M = 2e-3, 14.701e-3, 20e-3
FRICTIONS = (0.10, 0.12, 0.14)
COUPLER = {"stiffness_nm_per_rad": 2000.0, "damping_nm_s_per_rad": 0.2, "inertia_kg_m2": 2e-5}


def disc_force(deflection_m: np.ndarray) -> np.ndarray:
    """Force in N of one spring at deflections (n,), by DIN EN 16984; written from the formula, not
    from the plant.
    """
    outer, inner, t, h0 = (DISC[k] for k in ("outer_m", "inner_m", "thickness_m", "cone_m"))
    d = outer / inner
    k1 = ((d - 1) / d) ** 2 / ((d + 1) / (d - 1) - 2 / np.log(d)) / np.pi
    s = deflection_m
    return (
        4
        * YOUNG_PA
        / (1 - POISSON**2)
        * t**4
        / (k1 * outer**2)
        * (s / t)
        * ((h0 / t - s / t) * (h0 / t - s / (2 * t)) + 1)
    )


def free_nm(speed_rad_s: np.ndarray, exponential: bool = False) -> np.ndarray:
    """Friction of a free load at speeds (n,) by physics.md section 3: the Simscape form, or the
    older one.
    """
    tc, tbrk, w_brk = FREE["coulomb_nm"], FREE["breakaway_nm"], FREE["w_brk"]
    if exponential:
        at = np.maximum(np.abs(speed_rad_s), FREE["threshold"])
        torque = tc + (tbrk - tc) * np.exp(-FREE["decay"] * at)
        return (
            np.sign(speed_rad_s) * torque * np.minimum(np.abs(speed_rad_s) / FREE["threshold"], 1.0)
        )
    share = speed_rad_s / (np.sqrt(2) * w_brk)
    return np.sqrt(2 * np.e) * (tbrk - tc) * np.exp(-(share**2)) * share + tc * np.tanh(
        10 * speed_rad_s / w_brk
    )


def pendulum_nm(angle_rad: np.ndarray) -> np.ndarray:
    """Torque of the pendulum against the shaft at angles (n,) from where it hangs."""
    return PENDULUM["mass_kg"] * 9.81 * PENDULUM["length_m"] * np.sin(angle_rad)


def lever_m(friction: float) -> float:
    """Tightening torque over preload of the M16 bolt: 0.16 P + 0.58 d2 mu + D_Km / 2 mu."""
    return 0.16 * PITCH_M + (0.58 * FLANK_M + 0.5 * HEAD_M) * friction


def curve(rig: Rig, joint: str) -> dict[str, np.ndarray]:
    """Slip torque forwards and backwards over the head's turns from the start of the log."""
    turns = np.linspace(0.0, CURVE_TURNS[joint], 600)
    tool = with_joint(rig, JOINTS[joint])
    forward, backward = _core.joint_slip_torques(
        tool.parameters(), tool.load["kind"], 2 * np.pi * turns
    )
    return {"turns": turns, "forward_nm": forward, "backward_nm": backward}


def curve_row(rig: Rig, joint: str) -> dict[str, Any]:
    """Torque at the start, the most, and the work to get there."""
    found = curve(rig, joint)
    top = int(np.argmax(found["forward_nm"]))
    work = float(
        np.trapezoid(found["forward_nm"][: top + 1], 2 * np.pi * found["turns"][: top + 1])
    )
    return {
        "joint": joint,
        "start_nm": float(found["forward_nm"][0]),
        "most_nm": float(found["forward_nm"][top]),
        "most_turns": float(found["turns"][top]),
        "work_j": work,
        "backward_share": float(found["backward_nm"][top] / found["forward_nm"][top]),
    }


def simulated_stack(rig: Rig, duration_s: float) -> dict[str, np.ndarray]:
    """Force on the stack over its deflection as the impact tool tightens it from several depths:
    joint torque through the bolt's lever.

    While the joint slips its torque is the slip torque, so each sample at which the head turns is a
    point of the stack's curve.
    """
    load = JOINTS["disc_spring"]
    time_s = np.arange(2e-5, duration_s, 2e-5)
    deflection, force = [], []
    for from_turns in STACK_STARTS:
        run = simulate(
            [with_joint(rig, load, {"load.from_turns": from_turns})],
            duration_s,
            1.0,
            trace_s=time_s,
        )["trace"]
        speed = np.gradient(run["head_rad"], time_s)
        turning = (speed > 2.0) & (np.r_[speed[1:], 0.0] > 2.0) & (np.r_[0.0, speed[:-1]] > 2.0)
        deflection.append((from_turns + run["head_rad"][turning] / (2 * np.pi)) * PITCH_M)
        force.append(
            (run["anvil_torque_nm"][turning] - load["run_torque_nm"]) / lever_m(load["friction"])
        )
    order = np.argsort(np.concatenate(deflection))
    return {
        "deflection_mm": 1e3 * np.concatenate(deflection)[order],
        "force_n": np.concatenate(force)[order],
    }


def stack_figures(found: dict[str, np.ndarray]) -> dict[str, float]:
    """Agreement of simulated and calculated stack, and the reference spring."""
    calculated = PARALLEL * disc_force(found["deflection_mm"] * 1e-3 / SERIES)
    return {
        "single_at_0.75_n": float(disc_force(np.array([0.75 * DISC["cone_m"]]))[0]),
        "stack_length_mm": 1e3 * SERIES * (DISC["cone_m"] + PARALLEL * DISC["thickness_m"]),
        "samples": len(calculated),
        "deepest_mm": float(found["deflection_mm"][-1]),
        "deepest_n": float(calculated[-1]),
        "largest_difference_percent": float(
            100 * np.max(np.abs(found["force_n"] - calculated)) / calculated.max()
        ),
    }


def bolt_rows() -> list[dict[str, float]]:
    """Assembly preload and tightening torque at 90 % of yield per friction, and the preload that
    the middle torque gives with it.
    """
    middle = _core.bolt_torque(_core.bolt_preload(FRICTIONS[1]), FRICTIONS[1], FRICTIONS[1])
    rows = []
    for mu in FRICTIONS:
        preload = _core.bolt_preload(mu)
        rows.append(
            {
                "friction": mu,
                "preload_kn": preload / 1e3,
                "torque_nm": _core.bolt_torque(preload, mu, mu),
                "preload_at_middle_torque_kn": middle / lever_m(mu) / 1e3,
            }
        )
    return rows


def reached_torques(
    rig: Rig, voltages: tuple[float, ...], duration_s: float
) -> list[dict[str, float]]:
    """Torque that the impact tool leaves in the hard joint after a fixed time, per supply voltage."""
    rigs = [with_joint(rig, JOINTS["hard_joint"], {"supply.voltage_v": v}) for v in voltages]
    rows = simulate(rigs, duration_s, 1.0)
    load = JOINTS["hard_joint"]
    head = rows["head_rad"][:, -1]
    return [
        {
            "supply_v": v,
            "torque_nm": float(load["run_torque_nm"] + load["slip_slope_nm_per_rad"] * h),
        }
        for v, h in zip(voltages, head, strict=True)
    ]


def tightening(rig: Rig, duration_s: float) -> dict[str, Any]:
    """Tightening factor F_max / F_min of VDI 2230: by the scatter of friction, of the tool's
    supply, and of both.
    """
    bolt = bolt_rows()
    reached = reached_torques(rig, (17.0, 18.5, 20.0), duration_s)
    by_friction = lever_m(FRICTIONS[-1]) / lever_m(FRICTIONS[0])
    torques = [r["torque_nm"] for r in reached]
    by_supply = max(torques) / min(torques)
    return {
        "bolt": bolt,
        "reached": reached,
        "factor_friction": by_friction,
        "factor_supply": by_supply,
        "factor": by_friction * by_supply,
    }


def with_and_without_coupler(tool: Rig) -> dict[str, Rig]:
    """The tool without and with the torque sensor between anvil and joint."""
    k, c, inertia = (
        COUPLER[n] for n in ("stiffness_nm_per_rad", "damping_nm_s_per_rad", "inertia_kg_m2")
    )
    effect = {
        "stiffness_nm_per_rad": k,
        "damping_ratio": c / (2 * np.sqrt(k * inertia)),
        "inertia_kg_m2": inertia,
    }
    return {"without": tool, "with": tool.with_effects({"coupler_compliance": effect})}


def coupler_rows(rig: Rig, duration_s: float) -> list[dict[str, Any]]:
    """Blows on three joints without and with the torque sensor: torque peaks of the joint, rate,
    current.
    """
    rows = []
    for load in ("locked", "slip_60", "slip_6"):
        for name, tool in with_and_without_coupler(with_joint(rig, JOINTS[load])).items():
            run = simulate([tool], duration_s, 1.0)
            rows.append(
                {
                    "load": load,
                    "coupler": name,
                    **blow_figures(run, 0, 0.5 * duration_s, rig.mechanism["lug_height_m"]),
                }
            )
    return rows


def coupler_pulse(rig: Rig, duration_s: float) -> dict[str, dict[str, np.ndarray]]:
    """Torque of one blow on the locked joint, without and with the coupler, over the time from the
    blow.
    """
    found = {}
    for name, tool in with_and_without_coupler(with_joint(rig, JOINTS["locked"])).items():
        blows = simulate([tool], duration_s, 1.0)["blows"][0]
        last = float(blows["time_s"][blows["kind"] == 0][-2])
        time_s = last + np.arange(-0.2e-3, 2e-3, 2e-6)
        trace = simulate([tool], duration_s, 1.0, trace_s=time_s)["trace"]
        found[name] = {"time_ms": 1e3 * (time_s - last), "torque_nm": trace["anvil_torque_nm"]}
    return found


def motion(rig: Rig, load: str, duty: float, duration_s: float) -> dict[str, np.ndarray]:
    """Torque, current and hammer over time at one duty."""
    time_s = np.arange(2e-5, duration_s, 2e-5)
    trace = simulate([with_joint(rig, JOINTS[load])], duration_s, duty, trace_s=time_s)["trace"]
    return {
        "time_s": time_s,
        "torque_nm": trace["anvil_torque_nm"],
        "current_a": trace["current_a"],
        "hammer_mm": 1e3 * trace["hammer_m"],
        "head_deg": np.degrees(trace["head_rad"]),
    }


def load_study(rig: Rig, duration_s: float, tick: Tick) -> Study:
    """The whole study; ticks LOAD_TICKS times."""
    curves = {joint: curve(rig, joint) for joint in CURVES}
    rows = [curve_row(rig, joint) for joint in CURVES]
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
    return Study(
        "load",
        f"Loads of the {rig.name or 'impact driver'}",
        load_lines(figures, bolt, coupler),
        tables,
        pictures,
        data,
    )


LOAD_TICKS = 5


def motion_row(duty: float, m: dict[str, np.ndarray]) -> dict[str, float]:
    """Figures of one duty."""
    late = m["time_s"] > 0.5 * m["time_s"][-1]
    return {
        "duty": duty,
        "torque_peak_nm": float(m["torque_nm"].max()),
        "current_mean_a": float(m["current_a"][late].mean()),
        "hammer_max_mm": float(m["hammer_mm"][late].max()),
        "head_end_deg": float(m["head_deg"][-1]),
    }


def load_lines(
    figures: dict[str, float], bolt: dict[str, Any], coupler: list[dict[str, Any]]
) -> list[str]:
    """What was found, in sentences."""
    peak = {(r["load"], r["coupler"]): r for r in coupler}
    plain, coupled = peak["locked", "without"], peak["locked", "with"]
    difference = shown(max(figures["largest_difference_percent"], LEAST_SHOWN))
    lines = [
        f"The simulated stack of disc springs lies within {difference} % of the calculation; one spring at 0.75 h0 carries "
        f"{figures['single_at_0.75_n']:.0f} N.",
        f"Tightening factor {bolt['factor']:.2f}: {bolt['factor_friction']:.2f} from friction 0.10 to 0.14, {bolt['factor_supply']:.2f} "
        "from a supply of 17 to 20 V.",
    ]
    if plain["torque_peak_nm"] and coupled["torque_peak_nm"]:
        lines.append(
            f"With the coupler the peaks measured on the locked joint are {coupled['torque_peak_nm']:.0f} instead of "
            f"{plain['torque_peak_nm']:.0f} N m."
        )
    return lines


def joint_table(rows: list[dict[str, Any]]) -> Table:
    """Ends of the torque-angle curves."""
    return Table(
        "joints",
        "Torque over angle of the joints",
        [
            "joint",
            "torque at the start in N m",
            "most in N m",
            "reached after turns",
            "work until then in J",
            "backwards / forwards there",
        ],
        [
            [
                JOINT_SHORT[r["joint"]],
                *(r[k] for k in ("start_nm", "most_nm", "most_turns", "work_j", "backward_share")),
            ]
            for r in rows
        ],
    )


def disc_table(figures: dict[str, float]) -> Table:
    """Calculation and simulation of the stack."""
    words = {
        "single_at_0.75_n": "one spring at 0.75 h0 in N",
        "stack_length_mm": "free length of the stack in mm",
        "samples": "simulated samples",
        "deepest_mm": "deepest simulated deflection in mm",
        "deepest_n": "calculated force there in N",
        "largest_difference_percent": "largest difference simulated - calculated in % of the largest force",
    }
    return Table(
        "disc_springs",
        "Disc springs 40 x 20.4 x 1.5, n = 4, i = 42: DIN EN 16984 against the simulated stack",
        ["figure", "value"],
        [[words[k], v] for k, v in figures.items()],
    )


def bolt_table(bolt: dict[str, Any]) -> Table:
    """Bolt at three frictions."""
    return Table(
        "bolt",
        "Bolt M16, 12.9 at 90 % of yield (VDI 2230)",
        [
            "friction",
            "assembly preload in kN",
            "tightening torque in N m",
            "preload at the torque of 0.12 in kN",
        ],
        [list(r.values()) for r in bolt["bolt"]],
    )


def reached_table(bolt: dict[str, Any]) -> Table:
    """Tightening factor."""
    rows: list[list[Any]] = [
        [f"torque reached at {r['supply_v']:g} V in N m", r["torque_nm"]] for r in bolt["reached"]
    ]
    rows += [
        ["tightening factor by friction 0.10 to 0.14", bolt["factor_friction"]],
        ["tightening factor by supply 17 to 20 V", bolt["factor_supply"]],
        ["tightening factor by both", bolt["factor"]],
    ]
    return Table(
        "tightening",
        "Tightening factor of the hard joint, tool switched off after a fixed time",
        ["figure", "value"],
        rows,
    )


def coupler_table(rows: list[dict[str, Any]]) -> Table:
    """Blows without and with the torque sensor."""
    return Table(
        "coupler",
        "Torque sensor between anvil and joint: 2e-5 kg m2, 2,000 N m/rad, 0.2 N m s/rad",
        ["joint", "coupler", "peak torque in N m", "blows/min", "current in A", "deg per blow"],
        [
            [
                JOINT_SHORT[r["load"]],
                r["coupler"],
                r["torque_peak_nm"],
                r["blows_per_min"],
                r["current_a"],
                r["angle_per_blow_deg"],
            ]
            for r in rows
        ],
    )


def motion_table(rows: list[dict[str, float]]) -> Table:
    """Figures of both duties."""
    return Table(
        "motion",
        "Hard joint at 50 and 100 % duty",
        [
            "duty in %",
            "largest torque in N m",
            "mean current in A",
            "hammer back in mm",
            "head turned in deg",
        ],
        [
            [
                100 * r["duty"],
                r["torque_peak_nm"],
                r["current_mean_a"],
                r["hammer_max_mm"],
                r["head_end_deg"],
            ]
            for r in rows
        ],
    )


def curve_picture(curves: dict[str, dict[str, np.ndarray]]) -> Picture:
    """Torque over turns: screws and springs, and the hard joint on its own scale."""
    figure = make_subplots(rows=1, cols=2, column_widths=[0.7, 0.3], horizontal_spacing=0.1)
    for colour, (joint, c) in zip(COLOURS, curves.items(), strict=True):
        hard = joint == "hard_joint"
        at = {"row": 1, "col": 2 if hard else 1}
        x = 360 * c["turns"] if hard else c["turns"]
        figure.add_trace(
            go.Scatter(
                x=x,
                y=c["forward_nm"],
                name=JOINT_WORDS[joint],
                legendgroup=joint,
                line={"color": colour, "width": 2},
            ),
            **at,
        )
        figure.add_trace(
            go.Scatter(
                x=x,
                y=c["backward_nm"],
                name=f"{JOINT_WORDS[joint]}, backwards",
                legendgroup=joint,
                showlegend=False,
                line={"color": colour, "width": 1.2, "dash": "dash"},
            ),
            **at,
        )
    figure.update_xaxes(title_text="head angle in turns", row=1, col=1)
    figure.update_xaxes(title_text="head angle in °", row=1, col=2)
    figure.update_yaxes(title_text="slip torque in N m", col=1)
    note = "Torque at which the head turns, from the start of the log (screws 12 turns deep, springs 4 turns tight); dashed: backwards."
    return Picture("Torque over angle", style(figure, 520), note)


def other_picture() -> Picture:
    """Loads that do not slip: elastic twist of a locked joint, pendulum, free load."""
    figure = make_subplots(rows=1, cols=3, horizontal_spacing=0.09)
    degrees, speed = np.linspace(-180.0, 180.0, 181), np.linspace(-30.0, 30.0, 601)
    twist = np.linspace(-3.0, 3.0, 61)
    stiffness = JOINTS["locked"]["stiffness_nm_per_rad"]
    panels = (
        (
            1,
            twist,
            stiffness * np.radians(twist),
            f"locked joint, {stiffness:,} N m/rad",
            COLOURS[0],
            "solid",
        ),
        (
            2,
            degrees,
            pendulum_nm(np.radians(degrees)),
            "pendulum, 0.49 kg at 0.1 m",
            COLOURS[1],
            "solid",
        ),
        (3, speed, free_nm(speed), "free load, Stribeck", COLOURS[3], "solid"),
        (3, speed, free_nm(speed, exponential=True), "free load, older form", COLOURS[4], "dash"),
    )
    for col, x, y, name, colour, dash in panels:
        line = {"color": colour, "width": 2, "dash": dash}
        figure.add_trace(go.Scatter(x=x, y=y, name=name, mode="lines", line=line), row=1, col=col)
    for col, words in enumerate(("elastic twist in °", "angle in °", "speed in rad/s"), 1):
        figure.update_xaxes(title_text=words, row=1, col=col)
    figure.update_yaxes(title_text="torque in N m", col=1)
    note = "The free load's friction depends on speed instead of angle: 0.5 N m, breakaway 0.6 N m."
    return Picture("Torque of the loads that do not slip", style(figure, 430), note)


def stack_picture(found: dict[str, np.ndarray]) -> Picture:
    """Calculated curve and simulated points."""
    figure = go.Figure()
    deflection = np.linspace(0.0, SERIES * DISC["cone_m"], 200)
    x, y = thin(found["deflection_mm"], found["force_n"], points=600)
    figure.add_trace(
        go.Scatter(
            x=x,
            y=y,
            name="simulated tightening",
            mode="markers",
            marker={"color": COLOURS[3], "size": 4},
        )
    )
    figure.add_trace(
        go.Scatter(
            x=1e3 * deflection,
            y=PARALLEL * disc_force(deflection / SERIES),
            name="DIN EN 16984",
            line={"color": COLOURS[1], "width": 2},
        )
    )
    figure.update_xaxes(title_text="deflection of the stack in mm")
    figure.update_yaxes(title_text="force in N")
    note = "Points: joint torque of the impact run while the head turns, through the bolt's lever at friction 0.12."
    return Picture("Disc springs: calculation and simulation", style(figure, 460), note)


def coupler_picture(pulses: dict[str, dict[str, np.ndarray]]) -> Picture:
    """One blow without and with the coupler."""
    figure = go.Figure()
    for colour, (name, pulse) in zip((COLOURS[0], COLOURS[1]), pulses.items(), strict=True):
        figure.add_trace(
            go.Scatter(
                x=pulse["time_ms"],
                y=pulse["torque_nm"],
                name=f"{name} coupler",
                line={"color": colour, "width": 2},
            )
        )
    figure.update_xaxes(title_text="time from the blow in ms")
    figure.update_yaxes(title_text="measured torque in N m")
    note = "One settled blow on the locked joint; with the coupler it is the torque in the sensor's spring."
    return Picture("What the coupler does to the measured torque", style(figure, 460), note)


def motion_picture(motions: dict[float, dict[str, np.ndarray]]) -> Picture:
    """Torque, current and hammer over time, a column for each duty."""
    panels = (
        ("torque_nm", "torque in N m"),
        ("current_a", "current in A"),
        ("hammer_mm", "hammer in mm"),
    )
    figure = make_subplots(
        rows=len(panels),
        cols=len(motions),
        shared_xaxes=True,
        shared_yaxes=True,
        vertical_spacing=0.04,
        horizontal_spacing=0.04,
        column_titles=[f"{100 * duty:g} % duty" for duty in motions],
    )
    for col, m in enumerate(motions.values(), 1):
        for row, (key, words) in enumerate(panels, 1):
            x, y = thin(m["time_s"], m[key])
            figure.add_trace(
                go.Scatter(
                    x=x,
                    y=y,
                    name=words,
                    showlegend=False,
                    line={"color": COLOURS[row - 1], "width": 1},
                ),
                row=row,
                col=col,
            )
            figure.update_yaxes(title_text=words if col == 1 else "", row=row, col=col)
        figure.update_xaxes(title_text="time in s", row=len(panels), col=col)
    return Picture(
        "Torque, current and hammer motion over time",
        style(figure, 760),
        "Hard joint of 700 N m/rad, from rest.",
    )
