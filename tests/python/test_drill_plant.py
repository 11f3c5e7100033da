"""The drill driver in lock-step and alone: it agrees with its reference and with SciPy, limits the
torque by its clutch, runs under the firmware.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from drill_reference import Drill, run
from vgroove import _core, cli
from vgroove.errors import VgrooveError
from vgroove.log import read_log
from vgroove.plant_alone import make_drill, row_start_duty
from vgroove.rig import Rig, read_rig, write_rig
from vgroove.scenario import make_plant

ROOT = Path(__file__).resolve().parents[2]
RPM = 30.0 / np.pi
ROW_S = 1e-3


def rig(gear: str = "low", **changes: object) -> Rig:
    return read_rig(ROOT / f"rigs/drill_driver_{gear}.toml").with_values(
        {key.replace("__", "."): value for key, value in changes.items()}
    )


def run_alone(tool: Rig, seconds: float = 4.0) -> dict[str, np.ndarray]:
    """Rows of 1 ms at full trigger, whose duty rises exactly along the ramp of 0.3 s; (n,) each."""
    plant = make_drill(tool)
    duty = np.minimum(np.arange(round(seconds / ROW_S) + 1) * ROW_S / 0.3, 1.0)
    rows = [
        plant.advance(ROW_S, float(b), False, 0.0, float(a))
        for a, b in zip(duty[:-1], duty[1:], strict=True)
    ]
    names = ("speed_rad_s", "chuck_rad_s", "current_a", "shaft_nm", "shaft_peak_nm")
    return {name: np.array([getattr(row, name) for row in rows]) for name in names}


@pytest.mark.parametrize("gear", ["low", "high"])
@pytest.mark.parametrize(("pulse", "clutch_nm"), [(False, 30.0), (True, 30.0), (False, 1.5)])
def test_agrees_with_the_reference(gear: str, pulse: bool, clutch_nm: float) -> None:
    tool = rig(gear, mechanism__pulse=pulse, mechanism__clutch_nm=clutch_nm)
    best = _core.simulate_drill(tool.drill_parameters(), row_s=ROW_S, tolerance=1e-9)
    rows = run_alone(tool)
    for name in ("speed_rad_s", "chuck_rad_s"):
        assert np.max(np.abs(rows[name] - best[name][1:])) < 1e-3 * np.max(np.abs(best[name])), name
    mean_a = np.diff(best["charge_as"]) / ROW_S
    assert np.max(np.abs(rows["current_a"] - mean_a)) < 2e-3 * np.max(np.abs(mean_a))


def test_agrees_with_scipy_and_the_exponential_law_has_its_steady_torque() -> None:
    tool = rig("low", mechanism__pulse=True)
    other = run(Drill(pulse=True, end=2.6), np.arange(1, 2600) * ROW_S)
    rows = run_alone(tool, 2.6)
    for name in ("speed_rad_s", "chuck_rad_s"):
        assert np.max(np.abs(rows[name][:2599] - other[name])) < 1e-3 * np.max(
            np.abs(other[name])
        ), name
    exponential = run_alone(
        rig("low", load__form="exponential", load__from_s=0.0, load__to_s=9.0), 1.0
    )
    p = tool.drill_parameters()
    friction = 0.012 + 4.5e-6 * exponential["speed_rad_s"][-1]
    # Tc + (Tbrk - Tc) exp(-cv w) at a steady speed
    torque = 6.0 + 1.2 * np.exp(-10.0 * exponential["chuck_rad_s"][-1])
    assert exponential["shaft_nm"][-1] == pytest.approx(torque, rel=1e-3)
    assert exponential["current_a"][-1] * p[
        "motor.torque_constant_nm_per_a"
    ] * 31.5 == pytest.approx(torque + 31.5 * friction, rel=1e-3)


def test_the_shaft_never_carries_more_than_the_clutch() -> None:
    rows = run_alone(rig("low", mechanism__clutch_nm=4.0), 3.2)
    assert 3.99 < rows["shaft_peak_nm"].max() <= 4.0 + 1e-9
    # the chuck stands, the motor goes on
    assert rows["chuck_rad_s"][2900] < 0.1 < rows["speed_rad_s"][2900]


def test_a_load_that_rises_with_the_angle_stops_the_chuck_where_the_torques_meet() -> None:
    plant = make_drill(
        rig("low", load__torque_nm=0.0, load__rise_nm_per_rad=20.0, load__rise_from_rad=3.0)
    )
    for _ in range(1200):
        row = plant.advance(ROW_S, 0.3)
    stall = 31.5 * (0.0109 * 0.3 * 18.0 / 0.19 - 0.012)
    assert row.load_nm == pytest.approx(20.0 * (row.chuck_angle_rad - 3.0), rel=1e-3)
    # the tool's inertia turns the chuck beyond the angle of the stall torque; friction holds it
    assert stall < 0.95 * row.load_nm
    assert row.chuck_rad_s < 0.02


def test_hall_edges_and_pack_resistance() -> None:
    plant = make_plant(rig("high", supply__resistance_ohm=0.1, load__torque_nm=0.0), seed=1)
    ramp_periods = 9411  # 0.3 s
    edges, least_error_v = 0, 99.0
    for n in range(20_000):
        current, supply, found = plant.period(False, min(n / ramp_periods, 1.0), 0.0, 1.0)
        edges += len(found)
        least_error_v = min(
            least_error_v, supply - (18.0 - 0.1 * min(n / ramp_periods, 1.0) * current)
        )
    assert abs(edges - plant.angle_rad / (np.pi / 2.0)) <= 1.0
    assert edges > 300 and abs(least_error_v) < 0.02
    assert current == pytest.approx(
        (1.0 / 8.75 + 0.012 + 4.5e-6 * plant.speed_rad_s) / 0.0109, rel=1e-3
    )


def test_dead_time_costs_its_share_of_the_bus() -> None:
    speeds = []
    for dead in (0.0, 0.05):
        plant = make_plant(rig("low", load__torque_nm=0.0), seed=1)
        for _ in range(15_000):
            plant.period(False, 0.5, dead, 3.0)
        speeds.append(plant.speed_rad_s)
    assert speeds[0] - speeds[1] == pytest.approx(0.05 * 18.0 / 0.0109, rel=0.01)


def test_an_open_bridge_takes_the_current_through_the_diodes_and_then_nothing() -> None:
    plant = make_drill(rig("low", load__torque_nm=5.0, load__from_s=0.0))
    for _ in range(500):
        plant.advance(ROW_S, 1.0)
    assert plant.current_a > 10.0
    row = plant.advance(ROW_S, 1.0, True)
    assert 0.0 < row.current_a < 5.0 and plant.current_a == 0.0
    assert plant.advance(ROW_S, 1.0, True).current_a == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("words", "call"),
    [
        ("whole number of steps", lambda: make_drill(rig()).advance(1.01e-3, 1.0)),
        ("duty must be", lambda: make_drill(rig()).advance(1e-3, 1.1)),
        (
            "no pack resistance",
            lambda: make_drill(rig(mechanism__pulse=True, supply__resistance_ohm=0.1)),
        ),
        ("lock-step plant alone", lambda: _core.simulate_drill({"load.rise_nm_per_rad": 1.0})),
        ("unknown parameter motor.volt", lambda: _core.DrillPlant({"motor.volt": 1.0})),
    ],
)
def test_impossible_requests_are_refused(words: str, call: object) -> None:
    with pytest.raises(ValueError, match=words):
        call()


def test_unsuitable_rigs_are_refused_with_the_reason() -> None:
    with pytest.raises(VgrooveError, match="no effects, so not coulomb_friction"):
        rig().with_effects({"coulomb_friction": {"torque_nm": 0.01}}).drill_parameters()
    with pytest.raises(VgrooveError, match="not voltage_v"):
        rig(input__kind="voltage_v").drill_parameters()
    with pytest.raises(VgrooveError, match="cannot be simulated with the effects"):
        rig().parameters()
    with pytest.raises(VgrooveError, match="mechanism.pulse must be true or false"):
        rig(mechanism__pulse=1)
    with pytest.raises(VgrooveError, match="needs .mechanism. kind"):
        read_rig(ROOT / "rigs/board_18v.toml").drill_parameters()


def test_the_duty_of_a_row_starts_at_the_previous_value_within_the_slew_rate() -> None:
    duty = np.array([0.0, 0.003, 0.5, 0.5])
    assert np.array_equal(row_start_duty(duty, 4.0), [0.0, 0.0, 0.5, 0.5]) and np.array_equal(
        row_start_duty(duty, None), duty
    )


def invoke(*arguments: object) -> None:
    assert (
        CliRunner().invoke(cli.app, list(map(str, arguments)), catch_exceptions=False).exit_code
        == 0
    )


@pytest.mark.parametrize(
    ("gear", "slow", "fast", "mean", "peak"),
    [("low", 296, 394, 19, 37), ("high", 980, 1342, 22, 42)],
)
def test_sim_has_the_figures_of_the_specification(
    gear: str, slow: float, fast: float, mean: float, peak: float, tmp_path: Path
) -> None:
    write_rig(rig(gear, mechanism__pulse=True), tmp_path / "rig.toml")
    invoke(
        "sim", tmp_path / "rig.toml", "-o", tmp_path / "log.csv", "--json", tmp_path / "out.json"
    )
    log, figures = read_log(tmp_path / "log.csv"), json.loads((tmp_path / "out.json").read_text())
    load = (log.time_s >= 2.2) & (log.time_s <= 3.0)
    chuck = log["speed_rpm"][load] / (31.5 if gear == "low" else 8.75)
    assert len(log) == 4001 and (chuck.min(), chuck.max()) == (
        pytest.approx(slow, rel=0.01),
        pytest.approx(fast, rel=0.01),
    )
    assert log["current_a"][load].mean() == pytest.approx(mean, abs=0.6) and log[
        "current_a"
    ].max() == pytest.approx(peak, abs=1.0)
    assert figures["shaft_peak_nm"] < 30.0 and figures["clutch_slipped_s"] == 0.0


def scenario(tmp_path: Path, seconds: float) -> Path:
    text = (ROOT / "scenarios/drill_load.toml").read_text().replace("../rigs", str(ROOT / "rigs"))
    text = text.replace("duration_s = 4.0", f"duration_s = {seconds}")
    (tmp_path / "scenario.toml").write_text(text)
    return tmp_path / "scenario.toml"


def test_run_in_sil_agrees_with_the_plant_alone(tmp_path: Path) -> None:
    path = scenario(tmp_path, 2.6)
    invoke("run", path, "-o", tmp_path / "run.csv")
    invoke("sim", path, "-o", tmp_path / "sim.csv")
    board, model = read_log(tmp_path / "run.csv"), read_log(tmp_path / "sim.csv")
    for begin, end in ((1.0, 1.9), (2.2, 2.55)):  # free, and under 6 N m
        measured, modelled = ((log.time_s > begin) & (log.time_s < end) for log in (board, model))
        assert board["speed_rpm"][measured].mean() == pytest.approx(
            model["speed_rpm"][modelled].mean(), rel=2e-3
        )
        assert board["current_a"][measured].mean() == pytest.approx(
            model["current_a"][modelled].mean(), abs=0.15
        )


def test_run_on_the_simulated_avr_writes_the_same_rows(tmp_path: Path) -> None:
    # The run ends between two frames: at 0.6 s the AVR's last byte is sent a few cycles too late.
    path = scenario(tmp_path, 0.6005)
    invoke("run", path, "-o", tmp_path / "sil.csv")
    invoke("run", path, "--on", "avr", "-o", tmp_path / "avr.csv")
    assert (tmp_path / "sil.csv").read_bytes() == (tmp_path / "avr.csv").read_bytes()
