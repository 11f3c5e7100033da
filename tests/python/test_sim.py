"""`vgroove sim`: the printed gap is that of the diagnosis' problem, the CSV is a log, a scenario or
a rig drives the plant alone, and unusable input is an error that writes no file.
"""

import json
import time
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from typer.testing import CliRunner

from made_log import MadeLog, drive_log, rig
from vgroove import cli
from vgroove.errors import VgrooveError
from vgroove.gap.residual.loading import load_problem
from vgroove.log import read_log
from vgroove.reference.rigs import with_load
from vgroove.rig import read_rig, write_rig
from vgroove.units import RPM_PER_RAD_S

PRACTICE = Path(__file__).resolve().parents[1] / "data/practice"


def write_log(log: MadeLog, path: Path) -> Path:
    names = list(log.columns)
    rows = zip(log.time_s, *log.columns.values(), strict=True)
    path.write_text(
        "\n".join(
            [",".join(["time_s", *names]), *(",".join(f"{v:.9g}" for v in row) for row in rows)]
        )
        + "\n"
    )
    return path


def sim(*arguments: object) -> str:
    result = CliRunner().invoke(cli.app, ["sim", *map(str, arguments)], catch_exceptions=False)
    assert result.exit_code == 0
    return result.stdout


def test_the_gap_is_that_of_the_problem_and_names_its_held_out_intervals(tmp_path: Path) -> None:
    log = write_log(drive_log(rig(), seed=5), tmp_path / "log.csv")
    stated = rig().with_values({"motor.coulomb_nm": 0.013})
    write_rig(stated, tmp_path / "rig.toml")
    shown = sim(tmp_path / "rig.toml", "--log", log, "--json", tmp_path / "out.json")
    figures = json.loads((tmp_path / "out.json").read_text())
    problem = load_problem([log], stated)
    assert figures["gap"] == pytest.approx(
        problem.gap(problem.residuals(problem.theta0)[0]), rel=1e-9
    )
    assert f"gap {figures['gap']:.3f}" in shown
    assert figures["restart_s"] == 0.25 and figures["held_out_s"] == [[[0.0, 6.0]]]
    assert set(figures["by_signal"]) == {"current_a", "supply_v", "speed_rpm"}
    assert figures["by_signal"]["speed_rpm"]["gap"] > 3.0 > figures["by_signal"]["supply_v"]["gap"]


def test_the_gap_of_two_logs_pools_them(tmp_path: Path) -> None:
    logs = [write_log(drive_log(rig(), seed=s, seconds=4.0), tmp_path / f"{s}.csv") for s in (1, 2)]
    write_rig(rig().with_values({"motor.coulomb_nm": 0.013}), tmp_path / "rig.toml")
    sim(tmp_path / "rig.toml", "--log", logs[0], "--log", logs[1], "--json", tmp_path / "out.json")
    assert len(json.loads((tmp_path / "out.json").read_text())["held_out_s"]) == 2


def test_the_simulated_log_is_a_log_that_differs_by_the_noise(tmp_path: Path) -> None:
    log = write_log(drive_log(rig(), seed=5), tmp_path / "log.csv")
    write_rig(rig(), tmp_path / "rig.toml")
    sim(tmp_path / "rig.toml", "--log", log, "-o", tmp_path / "sim.csv")
    made, original = read_log(tmp_path / "sim.csv"), read_log(log)
    assert np.array_equal(made.time_s, original.time_s) and np.array_equal(
        made.columns["duty"], original.columns["duty"]
    )
    assert np.std(made.columns["current_a"] - original.columns["current_a"]) == pytest.approx(
        0.153, rel=0.1
    )


def test_a_missing_rig_and_two_outputs_are_refused(tmp_path: Path) -> None:
    write_rig(rig(), tmp_path / "rig.toml")
    logs = [write_log(drive_log(rig(), seed=s, seconds=2.0), tmp_path / f"{s}.csv") for s in (1, 2)]
    for arguments in (
        [tmp_path / "none.toml"],
        [tmp_path / "none.toml", "--log", logs[0]],
        [tmp_path / "rig.toml", "--log", logs[0], "--log", logs[1], "-o", tmp_path / "out.csv"],
    ):
        with pytest.raises(VgrooveError):
            CliRunner().invoke(cli.app, ["sim", *map(str, arguments)], catch_exceptions=False)
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    ("case", "low", "high"), [("002", 0.9, 1.06), ("012", 0.9, 1.08), ("001", 4.0, 4.5)]
)
def test_practice_logs_without_an_effect_end_at_the_noise(
    case: str, low: float, high: float, tmp_path: Path
) -> None:
    folder = PRACTICE / f"practice_{case}"
    for restart_s in ("0.25", "1000"):
        sim(
            folder / "rig.toml",
            "--log",
            folder / "log.csv",
            "--restart-s",
            restart_s,
            "--json",
            tmp_path / "out.json",
        )
        assert low < json.loads((tmp_path / "out.json").read_text())["gap"] < high


def test_a_practice_log_ends_at_the_noise_with_the_effect_of_its_label(
    tmp_path: Path,
) -> None:
    folder = PRACTICE / "practice_001"
    inertia = json.loads((folder / "label.json").read_text())["truth"]["added_inertia"]["dJ"]
    write_rig(
        read_rig(folder / "rig.toml").with_effects({"added_inertia": {"kg_m2": inertia}}),
        tmp_path / "rig.toml",
    )
    sim(tmp_path / "rig.toml", "--log", folder / "log.csv", "--json", tmp_path / "out.json")
    assert 0.9 < json.loads((tmp_path / "out.json").read_text())["gap"] < 1.08


def scenario_of(tmp_path: Path, reverse: bool = False) -> Path:
    write_rig(rig(), tmp_path / "rig.toml")
    text = (
        'schema = "vgroove.scenario/1"\nrig = "rig.toml"\nduration_s = 2.0\n'
        "[trigger]\ntravel = [[0.0, 0.0], [0.2, 0.0], [0.2, 1.0]]\n"
        f"reverse = [[0.0, {str(reverse).lower()}]]\n"
    )
    (tmp_path / "scenario.toml").write_text(text)
    return tmp_path / "scenario.toml"


def test_a_scenario_drives_the_plant_alone(tmp_path: Path) -> None:
    sim(scenario_of(tmp_path), "-o", tmp_path / "sim.csv", "--json", tmp_path / "out.json")
    made, stated = read_log(tmp_path / "sim.csv"), rig()
    assert np.all(made.columns["speed_rpm"][made.time_s <= 0.2] == 0.0) and np.all(
        made.columns["coast"][made.time_s <= 0.2] == 1.0
    )
    k, current = stated.motor["torque_constant_nm_per_a"], made.columns["current_a"][-1]
    resistance = stated.motor["resistance_ohm"] + stated.supply.get("resistance_ohm", 0.0)
    steady_rpm = (stated.supply["voltage_v"] - resistance * current) / k * RPM_PER_RAD_S
    assert made.columns["speed_rpm"][-1] == pytest.approx(steady_rpm, rel=1e-3)
    assert json.loads((tmp_path / "out.json").read_text())["speed_end_rpm"] == pytest.approx(
        made.columns["speed_rpm"][-1], rel=1e-6
    )


def test_the_plant_alone_is_the_same_backwards(tmp_path: Path) -> None:
    for reverse in (False, True):
        sim(scenario_of(tmp_path, reverse), "-o", tmp_path / f"{reverse}.csv")
    forwards, backwards = read_log(tmp_path / "False.csv"), read_log(tmp_path / "True.csv")
    assert np.allclose(forwards.columns["speed_rpm"], -backwards.columns["speed_rpm"])
    assert np.allclose(forwards.columns["supply_v"], backwards.columns["supply_v"])


def test_figures_are_printed_after_the_files_are_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A table suggests that the run is complete."""

    def full(files: list[tuple[Path, bytes]]) -> None:
        raise VgrooveError(f"{files[0][0]}: no space left")

    monkeypatch.setattr("vgroove.output.write_all", full)
    write_rig(rig(), tmp_path / "rig.toml")
    command = ["sim", str(tmp_path / "rig.toml"), "--seconds", "0.2", "-o", str(tmp_path / "a.csv")]
    run = CliRunner().invoke(cli.app, command)
    assert isinstance(run.exception, VgrooveError) and run.stdout == ""


def test_figures_that_cannot_be_written_are_an_error(tmp_path: Path) -> None:
    with pytest.raises(VgrooveError, match="cannot be written"):
        sim(scenario_of(tmp_path), "--json", tmp_path / "absent" / "out.json")


def log_with(**columns: float | np.ndarray) -> MadeLog:
    """A log of the tool with some columns replaced."""
    log = drive_log(rig(), seed=3)
    log.columns |= {
        name: np.full(len(log.time_s), value) if np.isscalar(value) else value
        for name, value in columns.items()
    }
    return log


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"duty": np.nan}, "column duty.* holds no value"),
        ({"duty": 0.0}, "column duty is 0 throughout while the shaft speeds up"),
        ({"current_a": np.nan, "speed_rpm": np.nan, "supply_v": np.nan}, "0 usable samples"),
    ],
)
def test_a_log_without_a_command_or_a_measurement_is_an_error(
    tmp_path: Path, columns: dict[str, float], words: str
) -> None:
    log = write_log(log_with(**columns), tmp_path / "log.csv")
    write_rig(rig(), tmp_path / "rig.toml")
    begin = time.process_time()
    with pytest.raises(VgrooveError, match=words):
        sim(tmp_path / "rig.toml", "--log", log)
    assert time.process_time() - begin < 5.0


@pytest.mark.parametrize(
    "columns",
    [
        {"duty": 0.0, "current_a": 0.0, "speed_rpm": 0.0, "supply_v": 18.0},
        {"duty": 0.0, "current_a": 0.0, "speed_rpm": 0.0, "supply_v": 0.0},
        {"current_a": 0.0, "speed_rpm": 0.0, "supply_v": 0.0},
        {"duty": 0.5, "current_a": 3.0, "speed_rpm": 5000.0, "supply_v": 18.0},
    ],
)
def test_a_log_whose_columns_are_constant_is_an_error(
    tmp_path: Path, columns: dict[str, float]
) -> None:
    log = write_log(log_with(**columns), tmp_path / "log.csv")
    write_rig(rig(), tmp_path / "rig.toml")
    with pytest.raises(VgrooveError, match="no measured column changes"):
        sim(tmp_path / "rig.toml", "--log", log, "--json", tmp_path / "out.json")
    assert not (tmp_path / "out.json").exists()


def test_a_shaft_that_runs_down_without_drive_is_judged_within_five_seconds(tmp_path: Path) -> None:
    log = write_log(
        log_with(duty=0.0, speed_rpm=np.linspace(5000.0, 0.0, 6001)), tmp_path / "log.csv"
    )
    write_rig(rig(), tmp_path / "rig.toml")
    begin = time.process_time()
    sim(tmp_path / "rig.toml", "--log", log, "--json", tmp_path / "out.json")
    assert time.process_time() - begin < 5.0 and np.isfinite(
        json.loads((tmp_path / "out.json").read_text())["gap"]
    )


RIGS = Path(__file__).resolve().parents[2] / "rigs"


def test_an_impact_rig_alone_runs_at_full_trigger(tmp_path: Path) -> None:
    sim(RIGS / "impact_driver.toml", "--json", tmp_path / "out.json")
    figures = json.loads((tmp_path / "out.json").read_text())
    assert figures["rows"] == 1001
    # docs/spec/model.md, section 4: hard joint
    assert figures["blows_per_min"] == pytest.approx(2857, rel=2e-3)
    assert figures["torque_peak_nm"] == pytest.approx(144, rel=0.01)


def test_options_of_a_run_with_a_log_are_refused_without_one(tmp_path: Path) -> None:
    write_rig(rig(), tmp_path / "rig.toml")
    options = ["--restart-s 2", "--from 0", "--to 1", "--as-is", "--map a=duty", "--map-file none"]
    for option in options:
        name = option.split()[0]
        with pytest.raises(VgrooveError, match=f"^{name}: only a run with --log has this option"):
            sim(tmp_path / "rig.toml", *option.split())


def joint_of(load: dict[str, object], path: Path) -> Path:
    """A file with the table [load] alone."""
    path.write_text(tomli_w.dumps({"load": load}))
    return path


@pytest.mark.parametrize("tool", ["rigs/impact_driver.toml", "scenarios/impact_hard_joint.toml"])
def test_the_joint_of_a_run_without_a_log_replaces_that_of_the_rig(
    tool: str, tmp_path: Path
) -> None:
    wood = RIGS / "impact_driver_wood_screw.toml"
    joint = joint_of(read_rig(wood).load, tmp_path / "joint.toml")
    files = ("--json", tmp_path / "out.json")
    seconds = ("--seconds", 0.5)
    found = []
    for arguments in ((wood,), (RIGS.parent / tool, "--joint", joint), (RIGS.parent / tool,)):
        sim(*arguments, *seconds, *files)
        found.append(json.loads((tmp_path / "out.json").read_text())["head_end_rad"])
    wood_rad, replaced_rad, own_rad = found
    assert abs(replaced_rad - own_rad) > 1.0
    if tool.startswith("rigs"):
        assert replaced_rad == pytest.approx(wood_rad)


def test_joints_that_a_run_without_a_log_cannot_have_are_refused(tmp_path: Path) -> None:
    joint = joint_of(read_rig(RIGS / "impact_driver.toml").load, tmp_path / "joint.toml")
    free = joint_of({"kind": "torque"}, tmp_path / "free.toml")
    text = (RIGS.parent / "scenarios/impact_hard_joint.toml").read_text()
    tool = RIGS / "impact_driver.toml"
    write_rig(with_load(read_rig(tool), {"kind": "torque"}), tmp_path / "tool.toml")
    path = tmp_path / "loaded.toml"
    lines = [
        f'rig = "{tmp_path / "tool.toml"}"' if line.startswith("rig ") else line
        for line in text.splitlines()
    ]
    path.write_text("\n".join(lines) + "\n[load]\ntorque_nm = [[0.0, 5.0]]\n")
    sim(path, "--seconds", 0.1, "--joint", free)
    for arguments, words in (
        ((RIGS / "impact_driver_18v.toml", "--joint", joint), "only a rig with .mechanism."),
        ((tool, "--joint", joint, "--joint", joint), "--joint: 2 for one run"),
        ((path, "--joint", joint), "a hard_joint makes its own torque"),
        ((tool, "--joint", joint, "-o", joint), "joint.toml"),
    ):
        with pytest.raises(VgrooveError, match=words):
            sim(*arguments)


def test_the_cycles_of_a_hammering_tool_have_no_restarts(tmp_path: Path) -> None:
    tool = RIGS / "impact_driver.toml"
    with pytest.raises(VgrooveError, match="--restart-s: .* the model is not restarted"):
        sim(tool, "--log", tmp_path / "log.csv", "--restart-s", 0.5)


def test_a_joint_of_a_tool_that_does_not_hammer_is_refused(tmp_path: Path) -> None:
    log = write_log(drive_log(rig(), seed=5, seconds=2.0), tmp_path / "log.csv")
    write_rig(rig(), tmp_path / "rig.toml")
    joint = joint_of({"kind": "none"}, tmp_path / "joint.toml")
    with pytest.raises(VgrooveError, match="only a rig with .mechanism."):
        sim(tmp_path / "rig.toml", "--log", log, "--joint", joint)


def test_a_rig_alone_is_driven_no_faster_than_its_slew(tmp_path: Path) -> None:
    write_rig(rig(), tmp_path / "rig.toml")
    sim(tmp_path / "rig.toml", "-o", tmp_path / "sim.csv")
    duty = read_log(tmp_path / "sim.csv").columns["duty"]
    slew = rig().input["slew_per_s"]
    assert (
        duty[0] == 0.0 and duty[-1] == 1.0 and np.max(np.diff(duty)) <= slew * 1e-3 * (1.0 + 1e-9)
    )


@pytest.mark.parametrize(("key", "value"), [("lug_overlap_rad", 3.2), ("hammer_start_rad", 0.5)])
def test_a_value_that_only_the_plant_refuses_is_an_error(
    key: str, value: float, tmp_path: Path
) -> None:
    text = (RIGS / "impact_driver.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith(key)]
    lines.insert(lines.index("[mechanism]") + 1, f"{key} = {value}")
    (tmp_path / "rig.toml").write_text("\n".join(lines) + "\n")
    with pytest.raises(VgrooveError, match="rig.toml"):
        sim(tmp_path / "rig.toml")


def test_rate_and_spread_are_those_of_the_pulled_trigger(tmp_path: Path) -> None:
    sim(RIGS.parent / "scenarios/impact_hard_joint.toml", "--json", tmp_path / "out.json")
    figures = json.loads((tmp_path / "out.json").read_text())
    assert (
        figures["blows_per_min"] == pytest.approx(2857, rel=5e-3)
        and figures["period_spread_percent"] < 1.0
    )


def test_the_pause_between_two_presses_is_no_blow_period(tmp_path: Path) -> None:
    found = {}
    for presses in (1, 2):
        starts = [0.1 + 1.3 * n for n in range(presses)]
        points = [
            p for s in starts for p in ([s, 0.0], [s + 0.05, 1.0], [s + 0.8, 1.0], [s + 0.8, 0])
        ]
        write_rig(read_rig(RIGS / "impact_driver.toml"), tmp_path / "rig.toml")
        (tmp_path / "scenario.toml").write_text(
            f'schema = "vgroove.scenario/1"\nrig = "rig.toml"\nduration_s = {1.3 * presses}\n'
            f"[trigger]\ntravel = {points}\n"
        )
        sim(tmp_path / "scenario.toml", "--json", tmp_path / "out.json")
        found[presses] = json.loads((tmp_path / "out.json").read_text())
    once, twice = found[1], found[2]
    assert once["blows_per_min"] > 2500.0 and twice["blows"] > 1.6 * once["blows"]
    assert twice["blows_per_min"] == pytest.approx(once["blows_per_min"], rel=0.01)
    assert twice["period_spread_percent"] < 2.0


@pytest.mark.parametrize(
    ("effect", "values", "column", "factor"),
    [
        ("speed_gain", {"relative": 0.2}, "speed_rpm", 1.2),
        ("speed_gain", {"relative": 0.2}, "position_rad", 1.2),
        ("current_gain", {"relative": 0.1}, "current_a", 1.1),
        ("supply_gain", {"relative": -0.1}, "supply_v", 0.9),
    ],
)
def test_a_sensor_of_the_rig_acts_in_the_log_of_the_plant_alone(
    effect: str, values: dict[str, float], column: str, factor: float, tmp_path: Path
) -> None:
    scenario, found = scenario_of(tmp_path), []
    for effects in ({}, {effect: values}):
        write_rig(rig().with_effects(effects), tmp_path / "rig.toml")
        sim(scenario, "-o", tmp_path / "sim.csv")
        found.append(read_log(tmp_path / "sim.csv").columns[column])
    assert np.allclose(found[1], factor * found[0], rtol=1e-6) and np.max(found[0]) > 0.1


@pytest.mark.parametrize("form", ["filter", "delay"])
def test_the_speed_of_the_plant_alone_lags_as_its_sensor(form: str, tmp_path: Path) -> None:
    scenario, found = scenario_of(tmp_path), []
    for effects in ({}, {"speed_lag": {"time_constant_s": 0.05, "form": form}}):
        write_rig(rig().with_effects(effects), tmp_path / "rig.toml")
        sim(scenario, "-o", tmp_path / "sim.csv")
        found.append(read_log(tmp_path / "sim.csv").columns["speed_rpm"])
    assert found[1][260] < 0.9 * found[0][260]
    assert found[1][-1] == pytest.approx(found[0][-1], rel=1e-3)
