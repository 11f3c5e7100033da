"""Effect of a torque sensor between anvil and joint, called coupler in the results, on the
measured blows, for `vgroove study load`.
"""

from typing import Any

import numpy as np
import plotly.graph_objects as go

from vgroove.html_page import Picture, Table, style
from vgroove.reference.joints import REFERENCE_JOINTS
from vgroove.rig import Rig
from vgroove.study.impact_runs import blow_figures, last_cycle, simulate, with_joint

# A torque sensor of docs/spec/model.md, section 6
COUPLER = {"stiffness_nm_per_rad": 2000.0, "damping_nm_s_per_rad": 0.2, "inertia_kg_m2": 2e-5}
SETTLED_SHARE = 0.5  # figures are taken from this share of the run on
PULSE_FROM_S, PULSE_TO_S, PULSE_STEP_S = -0.2e-3, 2e-3, 2e-6  # drawn around a blow
COLOURS = {"without": "#30343b", "with": "#d1495b"}


def with_and_without_coupler(tool: Rig) -> dict[str, Rig]:
    """The tool `without` and `with` the torque sensor between anvil and joint."""
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
    """Torque peaks, rate and current on three joints, without and with the torque sensor."""
    rows = []
    for load in ("locked", "slip_60", "slip_6"):
        for name, tool in with_and_without_coupler(with_joint(rig, load)).items():
            run = simulate([tool], duration_s, 1.0)
            rows.append(
                {
                    "load": load,
                    "coupler": name,
                    **blow_figures(
                        run, 0, SETTLED_SHARE * duration_s, rig.mechanism["lug_height_m"]
                    ),
                }
            )
    return rows


def coupler_pulse(rig: Rig, duration_s: float) -> dict[str, dict[str, np.ndarray]]:
    """Torque of one blow on the locked joint over the time from the blow, without and with the
    sensor.
    """
    found = {}
    for name, tool in with_and_without_coupler(with_joint(rig, "locked")).items():
        blows = simulate([tool], duration_s, 1.0)["blows"][0]
        last, _ = last_cycle(tool, blows, 0.0, duration_s, 1.0)
        time_s = last + np.arange(PULSE_FROM_S, PULSE_TO_S, PULSE_STEP_S)
        trace = simulate([tool], duration_s, 1.0, trace_s=time_s)["trace"]
        found[name] = {"time_ms": 1e3 * (time_s - last), "torque_nm": trace["anvil_torque_nm"]}
    return found


def coupler_table(rows: list[dict[str, Any]]) -> Table:
    """The figures of coupler_rows."""
    keys = ("torque_peak_nm", "blows_per_min", "current_a", "angle_per_blow_deg")
    return Table(
        "coupler",
        "Torque sensor between anvil and joint: 2e-5 kg m2, 2,000 N m/rad, 0.2 N m s/rad",
        ["joint", "coupler", "peak torque in N m", "blows/min", "current in A", "deg per blow"],
        [
            [
                REFERENCE_JOINTS[r["load"]].short,
                r["coupler"],
                *(r[k] for k in keys),
            ]
            for r in rows
        ],
    )


def coupler_picture(pulses: dict[str, dict[str, np.ndarray]]) -> Picture:
    """One blow without and with the sensor."""
    figure = go.Figure()
    for name, pulse in pulses.items():
        figure.add_trace(
            go.Scatter(
                x=pulse["time_ms"],
                y=pulse["torque_nm"],
                name=f"{name} coupler",
                line={"color": COLOURS[name], "width": 2},
            )
        )
    figure.update_xaxes(title_text="time from the blow in ms")
    figure.update_yaxes(title_text="measured torque in N m")
    note = (
        "One settled blow on the locked joint; with the coupler the torque is that in the sensor's "
        "spring."
    )
    return Picture("Effect of the coupler on the measured torque", style(figure, 460), note)
