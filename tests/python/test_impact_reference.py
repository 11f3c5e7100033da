"""The impact tool of the plant against its independent reference (impact_reference.py and .json),
and tests of that reference itself.
"""

from __future__ import annotations

import functools
import json
import math

import numpy as np
import pytest

import impact_reference as reference
from vgroove import _core as core

FILE = json.loads(reference.RESULTS.read_text())
PLACE = {name: place for place, name in enumerate(FILE["columns"])}
LIVE_S = 0.06  # part of a case that the test integrates again


def column(case: str, name: str) -> np.ndarray:
    return np.array(FILE["cases"][case]["rows"])[:, PLACE[name]]


def contacts(case: str, *kinds: int) -> np.ndarray:
    """Rows of contact_columns of the kinds asked for."""
    return np.array([c for c in FILE["cases"][case]["contacts"] if c[2] in kinds])


def settled_period_s(case: str) -> float:
    times = contacts(case, reference.BLOW)[:, 0]
    return float(np.mean(np.diff(times[len(times) // 2 :])))


def settled_current_a(case: str) -> float:
    """Mean over whole periods: the last half of the run, in which the current repeats."""
    times = contacts(case, reference.BLOW)[:, 0]
    first, last = times[len(times) // 2], times[-1]
    charge = np.interp([first, last], column(case, "time_s"), column(case, "charge_as"))
    return float((charge[1] - charge[0]) / (last - first))


def test_file_holds_the_cases_of_the_script() -> None:
    assert FILE["cases"].keys() == reference.CASES.keys()
    assert [c.changes for c in reference.CASES.values()] == [
        c["changes"] for c in FILE["cases"].values()
    ]
    assert FILE["columns"] == reference.COLUMNS


@pytest.mark.parametrize(
    ("case", "method"),
    [
        ("slip_60", "DOP853"),
        ("slope_700", "LSODA"),
        ("slip_6", "DOP853"),
        ("locked_duty_0.5", "LSODA"),
    ],
)
def test_file_is_what_another_method_gives(case: str, method: str) -> None:
    """The file was computed by Radau; explicit Runge-Kutta and LSODA give the same first blows."""
    live = reference.simulate(reference.CASES[case].tool(), LIVE_S, method, row_s=reference.ROW_S)
    expected, rows = (
        [c for c in FILE["cases"][case]["contacts"] if c[0] < LIVE_S],
        np.array(FILE["cases"][case]["rows"]),
    )
    assert [(c.lug, c.kind) for c in live.contacts] == [(c[1], c[2]) for c in expected]
    np.testing.assert_allclose(
        [c.time_s for c in live.contacts], [c[0] for c in expected], rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(
        [c.approach_rad_s for c in live.contacts], [c[3] for c in expected], rtol=1e-5, atol=1e-4
    )
    scale = np.max(np.abs(rows), axis=0) + 1e-12
    np.testing.assert_allclose(
        np.array(live.rows) / scale, rows[: len(live.rows)] / scale, rtol=0, atol=1e-5
    )


@pytest.mark.parametrize(
    ("case", "blows_per_min", "current_a", "within"),
    [
        ("locked", 2857, 32.3, 1e-3),
        ("slope_700", 2857, 32.3, 1e-3),
        ("slip_60", 3241, 27.5, 2e-3),
        ("slip_6", 2771, 25.5, 1e-3),
    ],
)
def test_reference_has_the_figures_of_the_specification(
    case: str, blows_per_min: float, current_a: float, within: float
) -> None:
    assert 60.0 / settled_period_s(case) == pytest.approx(blows_per_min, rel=within)
    assert settled_current_a(case) == pytest.approx(current_a, abs=0.2)


def test_reference_has_peaks_travel_and_free_speed() -> None:
    assert contacts("slope_700", reference.BLOW)[-5:-1, 4] == pytest.approx(144.0, abs=0.5)
    assert FILE["cases"]["slope_700"]["hammer_mm"] == pytest.approx(10.9, abs=0.05)
    assert column("free", "speed_rad_s")[-1] / 5.6 * 30 / math.pi == pytest.approx(2813, abs=0.5)
    assert column("free", "current_a")[-1] == pytest.approx(1.8, abs=0.05)


def test_reference_loses_synchronism_as_specified() -> None:
    def contacts_per_lug(case: str) -> float:
        lugs = contacts(case, reference.BLOW, reference.REPEAT)[:, 1]
        settled = lugs[lugs >= 3]
        return len(settled[settled < settled[-1]]) / len(set(settled[settled < settled[-1]]))

    periods = np.diff(contacts("locked_duty_0.7", reference.BLOW)[6:, 0])
    assert np.std(periods) / np.mean(periods) == pytest.approx(0.24, abs=0.01)
    assert contacts_per_lug("locked_duty_0.5") == pytest.approx(2.0, abs=0.01)
    assert contacts_per_lug("locked_duty_0.3") == pytest.approx(3.0, abs=0.3)


# Rig key of each field of the reference's Tool
KEYS = {
    "voc": "supply.voltage_v",
    "rs": "supply.resistance_ohm",
    "r": "motor.resistance_ohm",
    "l": "motor.inductance_h",
    "kt": "motor.torque_constant_nm_per_a",
    "jm": "motor.inertia_kg_m2",
    "b": "motor.viscous_nm_s_per_rad",
    "tc": "motor.coulomb_nm",
    "n": "gearbox.ratio",
    "jj": "gearbox.output_inertia_kg_m2",
    "js": "mechanism.hammer_inertia_kg_m2",
    "m": "mechanism.hammer_mass_kg",
    "lead": "mechanism.groove_lead_m_per_rad",
    "vertex": "mechanism.vertex_rad",
    "q_max": "mechanism.travel_rad",
    "f0": "mechanism.spring_preload_n",
    "k": "mechanism.spring_rate_n_per_m",
    "lugs": "mechanism.lug_count",
    "h": "mechanism.lug_height_m",
    "r_lug": "mechanism.lug_radius_m",
    "overlap": "mechanism.lug_overlap_rad",
    "ck": "mechanism.contact_stiffness_n_per_m",
    "cb": "mechanism.contact_damping_n_s_per_m",
    "ramp": "mechanism.contact_ramp_m",
    "ja": "mechanism.anvil_inertia_kg_m2",
    "kj": "load.stiffness_nm_per_rad",
    "cj": "load.damping_nm_s_per_rad",
    "run_nm": "load.run_torque_nm",
    "slope": "load.slip_slope_nm_per_rad",
    "loosen": "load.loosen_ratio",
    "from_turns": "load.from_turns",
}
MIRRORED = [
    "current_a",
    "speed_rad_s",
    "angle_rad",
    "anvil_torque_nm",
    "anvil_angle_rad",
    "head_rad",
    "hammer_rad",
    "housing_nm",
]
LOCKED_NM = 1e9  # a slip torque that is never reached
LOADS = {"hard": "hard_joint", "wood": "wood_screw", "discs": "disc_spring"}
WOOD = {
    "load.start_nm": reference.WOOD_START,
    "load.end_nm": reference.WOOD_END,
    "load.turns": reference.WOOD_TURNS,
    "load.seat_nm": reference.WOOD_SEAT,
    "load.seat_deg": reference.WOOD_SEAT_DEG,
    "load.stripped_ratio": reference.WOOD_STRIPPED,
    "load.loosen_ratio": reference.WOOD_LOOSEN,
}
DISCS = {
    "load.parallel": reference.DISC_PARALLEL,
    "load.series": reference.DISC_SERIES,
    "load.friction": reference.BOLT_MU,
}
IMPACTS = [name for name in reference.CASES if name != "free"]
TURNING = [name for name in IMPACTS if not name.startswith("locked")]
BOTH_MODES = pytest.mark.parametrize("mode", ["reference", "fast"])
needs_plant = pytest.mark.skipif(
    not hasattr(core, "simulate_impact"), reason="the bindings have no impact mechanism"
)


@functools.cache
def plant_run(case: str, mode: str) -> dict:
    """The plant's run of a case, rows of 1 ms."""
    tool = reference.CASES[case].tool()
    theta = np.array(core.parameter_defaults())
    theta[core.PARAMETERS.index("mechanism.groove_radius_m")] = 0.010
    values = {key: min(getattr(tool, name), LOCKED_NM) for name, key in KEYS.items()}
    values |= {"wood": WOOD, "discs": DISCS}.get(tool.joint, {})
    for key, value in values.items():
        theta[core.PARAMETERS.index(key)] = value
    time_s = np.arange(round(reference.CASES[case].seconds * 1000) + 1) * 1e-3
    stopped = time_s > tool.stop_s + 1e-9
    duty = np.where(
        stopped,
        0.0,
        np.minimum(tool.duty, tool.slew * time_s) if math.isfinite(tool.slew) else tool.duty,
    )
    more = {"slew_per_s": tool.slew} if math.isfinite(tool.slew) else {}
    more |= {"coast": stopped.astype(float)} if tool.coast else {}
    log = core.LogInput(
        time_s, "duty", -duty if tool.mirrored else duty, load_kind=LOADS[tool.joint], **more
    )
    rows = core.simulate_impact(log, theta[None, :], mode=mode)
    return rows | {name: -rows[name] for name in MIRRORED} if tool.mirrored else rows


def plant_contacts(case: str, mode: str, *kinds: int) -> np.ndarray:
    found = plant_run(case, mode)["blows"][0]
    return found[np.isin(found["kind"], kinds)]


def at_rows(case: str, mode: str, name: str) -> np.ndarray:
    """A column of the plant at the rows that the reference keeps."""
    return plant_run(case, mode)[name][0, np.round(column(case, "time_s") * 1e3).astype(int)]


@needs_plant
@BOTH_MODES
@pytest.mark.parametrize("case", IMPACTS)
def test_every_contact_of_the_plant_is_within_20_us(case: str, mode: str) -> None:
    expected, found = contacts(case, 0, 1, 2), plant_contacts(case, mode, 0, 1, 2)
    assert found["kind"].tolist() == expected[:, 2].tolist()
    way = -1 if reference.CASES[case].tool().mirrored else 1
    assert (way * (found["lug"] - found["lug"][0])).tolist() == (
        expected[:, 1] - expected[0, 1]
    ).tolist()
    np.testing.assert_allclose(found["time_s"], expected[:, 0], rtol=0, atol=20e-6)
    blow = expected[:, 2] == reference.BLOW
    np.testing.assert_allclose(found["approach_rad_s"][blow], expected[blow, 3], rtol=2e-3)


@needs_plant
@BOTH_MODES
@pytest.mark.parametrize("case", IMPACTS)
def test_period_current_and_bus_of_the_plant_are_within_a_thousandth(case: str, mode: str) -> None:
    expected, found = (
        contacts(case, reference.BLOW)[:, 0],
        plant_contacts(case, mode, reference.BLOW)["time_s"],
    )
    assert (found[-1] - found[0]) / (expected[-1] - expected[0]) == pytest.approx(1.0, abs=1e-3)
    seconds = reference.CASES[case].seconds
    for name, integral in (("current_a", "charge_as"), ("supply_v", "bus_vs")):
        assert np.mean(plant_run(case, mode)[name][0, 1:]) == pytest.approx(
            column(case, integral)[-1] / seconds, rel=1e-3
        )


@needs_plant
@BOTH_MODES
@pytest.mark.parametrize("case", TURNING)
def test_angle_of_the_screw_is_within_a_thousandth(case: str, mode: str) -> None:
    np.testing.assert_allclose(
        at_rows(case, mode, "head_rad"),
        column(case, "head_rad"),
        rtol=0,
        atol=1e-3 * column(case, "head_rad")[-1],
    )


@needs_plant
@BOTH_MODES
@pytest.mark.parametrize("case", IMPACTS)
def test_peaks_and_travel_of_the_plant(case: str, mode: str) -> None:
    expected, found = contacts(case, reference.BLOW), plant_contacts(case, mode, reference.BLOW)
    np.testing.assert_allclose(found["peak_torque_nm"][:-1], expected[:-1, 4], rtol=2e-3)
    rows = at_rows(case, mode, "hammer_mm")
    np.testing.assert_allclose(
        rows, column(case, "hammer_mm"), rtol=0, atol=1e-2 * FILE["cases"][case]["hammer_mm"]
    )


@needs_plant
@pytest.mark.parametrize("case", IMPACTS)
def test_reference_mode_agrees_with_the_reference_within_1e_6(case: str) -> None:
    """Every column to a millionth of its largest value, every contact to 0.1 us."""
    np.testing.assert_allclose(
        plant_contacts(case, "reference", 0, 1, 2)["time_s"],
        contacts(case, 0, 1, 2)[:, 0],
        rtol=0,
        atol=1e-7,
    )
    for name in (
        "speed_rad_s",
        "angle_rad",
        "anvil_torque_nm",
        "anvil_angle_rad",
        "hammer_mm",
        "hammer_rad",
    ):
        expected = column(case, name)
        np.testing.assert_allclose(
            at_rows(case, "reference", name),
            expected,
            rtol=0,
            atol=1e-6 * np.max(np.abs(expected)),
            err_msg=name,
        )


@needs_plant
@BOTH_MODES
@pytest.mark.parametrize("case", IMPACTS)
def test_housing_reaction_of_the_plant(case: str, mode: str) -> None:
    """Means over the reference's rows, within 1e-6 (reference mode) or 0.5 % (fast mode) of the
    largest.
    """
    rows = (
        plant_run(case, mode)["housing_nm"][0, 1:]
        .reshape(-1, round(reference.ROW_S * 1e3))
        .mean(axis=1)
    )
    expected = np.diff(column(case, "housing_nms")) / reference.ROW_S
    np.testing.assert_allclose(
        rows,
        expected,
        rtol=0,
        atol=(1e-6 if mode == "reference" else 5e-3) * np.max(np.abs(expected)),
    )
