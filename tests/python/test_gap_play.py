"""A play is identified whatever the coefficient of restitution of its flanks, which no rig states;
the corrected rig holds the flanks as a coupler's spring and damper.
"""

import numpy as np
import pytest

from made_log import drive_log, rig
from vgroove.gap import diagnose
from vgroove.gap.simulate import compute_gap
from vgroove.rig import Rig

UP_AND_DOWN = [
    (0.2, 0.8),
    (0.7, 0.1),
    (1.2, 0.9),
    (1.8, 0.2),
    (2.3, 0.6),
    (2.8, 0.0),
    (3.3, 0.7),
    (3.7, 0.1),
]


def with_play(restitution: float, flank_rad_s: float) -> Rig:
    """A tool with 0.15 rad of play between flanks of this coefficient of restitution and natural
    frequency (rad/s) with both sides.
    """
    plain = rig(gearbox={"output_inertia_kg_m2": 2.4e-4})
    motor, output = (
        plain.motor["inertia_kg_m2"],
        plain.gearbox["output_inertia_kg_m2"] / plain.gearbox["ratio"] ** 2,
    )
    reduced = motor * output / (motor + output)
    damping = (
        -np.log(restitution) / np.hypot(np.pi, np.log(restitution)) * np.sqrt(reduced / output)
    )
    flanks = {
        "stiffness_nm_per_rad": flank_rad_s**2 * reduced,
        "damping_ratio": damping,
        "inertia_kg_m2": 0.0,
    }
    return plain.with_effects({"gear_backlash": {"play_rad": 0.15}, "coupler_compliance": flanks})


@pytest.mark.parametrize(
    ("restitution", "flank_rad_s"),
    [(0.55, 5000.0), pytest.param(0.75, 2500.0, marks=pytest.mark.proof)],
)
def test_a_play_is_identified_whatever_the_restitution_of_its_flanks(
    restitution: float, flank_rad_s: float
) -> None:
    made = drive_log(with_play(restitution, flank_rad_s), seconds=4.2, levels=UP_AND_DOWN)
    found = diagnose([made], rig(gearbox={"output_inertia_kg_m2": 2.4e-4}))
    verdict = found.as_dict()
    assert (verdict["verdict"], verdict["selected"]) == ("effect", ["gear_backlash"])
    assert verdict["gap"]["after"] < 1.1
    assert set(verdict["effects"][0]["parameters"]) == {"play_rad"}
    assert verdict["effects"][0]["parameters"]["play_rad"]["value"] == pytest.approx(0.15, rel=0.03)
    assert set(found.corrected_rig().effects) == {"gear_backlash", "coupler_compliance"}
    assert compute_gap(found.corrected_rig(), [made])[0]["gap"] == pytest.approx(
        verdict["gap"]["refit"], rel=0.01
    )
