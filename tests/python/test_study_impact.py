"""The studies of the impact tool by the command line, on reduced grids: laws of docs/spec/model.md,
sections 4 and 6, in their JSON.
"""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from browser import seen
from test_study import rows_of, vgroove
from vgroove.reference.blows import clean
from vgroove.reference.bolt import lever_m
from vgroove.reference.rigs import impact_rig
from vgroove.rig import read_rig, write_rig
from vgroove.study.disc_springs import disc_force
from vgroove.study.impact import phases_of
from warm_cli import Settings, warm_vgroove

ROOT = Path(__file__).resolve().parents[2]
BLOW = np.dtype([("time_s", "f8"), ("engaged_m", "f8"), ("kind", "i8"), ("skipped", "i8")])


def made(folder: Path, *arguments: str) -> dict:
    done = vgroove("study", *arguments, "-o", "out", cwd=folder)
    assert done.returncode == 0, done.stderr
    return json.loads((folder / f"out/{arguments[0]}.json").read_text())


@pytest.fixture(scope="module")
def supply(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("supply")
    return folder / "out", made(
        folder, "supply", "--step", "0.5", "--from", "16", "--to", "21", "--seconds", "1.2"
    )


@pytest.fixture(scope="module")
def load(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("load")
    return folder / "out", made(folder, "load", "--seconds", "0.6")


@pytest.fixture(scope="module")
def impact(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    folder = tmp_path_factory.mktemp("impact")
    return folder / "out", made(folder, "impact")


def test_the_reference_tool_is_the_rig_of_the_tree() -> None:
    ours, files = impact_rig(None), read_rig(ROOT / "rigs/impact_driver.toml")
    for section in ("supply", "motor", "gearbox", "mechanism"):
        assert getattr(ours, section) == getattr(files, section)
    assert ours.load["kind"] == "locked"


def test_rate_and_current_rise_with_the_supply_and_synchronism_is_lost(
    supply: tuple[Path, dict],
) -> None:
    rows = supply[1]["rows"]
    for joint in {row["load"] for row in rows}:
        mine = [row for row in rows if row["load"] == joint]
        assert [row["supply_v"] for row in mine] == list(np.arange(16.0, 21.25, 0.5))
        assert mine[-1]["blows_per_min"] > 1.1 * mine[0]["blows_per_min"]
        assert np.all(np.diff([row["current_a"] for row in mine]) > 0.0)
        assert all(0.0 <= row["synchronism"] <= 1.0 for row in mine)
    slipping = {row["supply_v"]: row for row in rows if row["load"] == "slip_60"}
    assert slipping[18.5]["synchronism"] == 1.0
    # docs/spec/model.md, section 4: about half of the lug height
    assert slipping[20.5]["engaged_percent"] == pytest.approx(50, abs=12)
    assert slipping[21.0]["synchronism"] < 0.5


@pytest.mark.parametrize(
    ("joint", "rate", "current"),
    [("locked", 2857, 32.3), ("slip_60", 3241, 27.5), ("slip_6", 2771, 25.5)],
)
def test_the_reference_set_shows_its_figures(
    supply: tuple[Path, dict], joint: str, rate: float, current: float
) -> None:
    row = next(r for r in supply[1]["rows"] if (r["load"], r["supply_v"]) == (joint, 18.5))
    assert row["blows_per_min"] == pytest.approx(rate, rel=2e-3)
    assert row["current_a"] == pytest.approx(current, abs=0.1)


def test_supply_table_agrees_with_the_json(supply: tuple[Path, dict]) -> None:
    table, rows = rows_of(supply[0], "supply_runs.csv"), supply[1]["rows"]
    assert len(table) == len(rows)
    assert [float(r["blows/min"]) for r in table] == pytest.approx(
        [r["blows_per_min"] for r in rows], rel=1e-5
    )


def test_clean_blows() -> None:
    def hits(*rows: tuple) -> np.ndarray:
        return np.array(list(rows), dtype=BLOW)

    regular = [(0.02 * n, 4e-3, 0, 0) for n in range(6)]
    assert clean(hits(*regular), 4.5e-3).all()
    assert clean(hits(*regular[:5], (0.1, 2.26e-3, 0, 0)), 4.5e-3).all()
    assert list(clean(hits(*regular[:5], (0.1, 2.24e-3, 0, 0)), 4.5e-3)) == [True] * 5 + [False]
    assert list(clean(hits(*regular[:5], (0.1, 4e-3, 0, 1)), 4.5e-3)) == [True] * 5 + [False]
    assert list(clean(hits(*regular[:5], (0.0823, 4e-3, 1, 0), (0.1, 4e-3, 0, 0)), 4.5e-3)) == [
        True
    ] * 5 + [False, True]
    assert list(clean(hits(*regular[:5], (0.1019, 4e-3, 0, 0)), 4.5e-3)) == [True] * 6
    assert list(clean(hits(*regular[:5], (0.1021, 4e-3, 0, 0)), 4.5e-3)) == [True] * 5 + [False]


def test_loads_obey_section_6_of_the_model(load: tuple[Path, dict]) -> None:
    data = load[1]
    springs = data["disc_springs"]
    assert springs["single_at_0.75_n"] == pytest.approx(2621, abs=1)
    assert (
        springs["largest_difference_percent"] < 0.01
        and springs["samples"] > 1000
        and springs["deepest_mm"] > 40
    )
    assert [row["torque_nm"] for row in data["bolt"]["bolt"]] == pytest.approx(
        [310, 354, 395], abs=0.6
    )
    assert [row["preload_kn"] for row in data["bolt"]["bolt"]] == pytest.approx(
        [142.5, 139.2, 135.6], abs=0.06
    )
    assert data["bolt"]["factor_friction"] == pytest.approx(lever_m(0.14) / lever_m(0.10))
    assert (
        data["bolt"]["factor"] > data["bolt"]["factor_friction"] > 1.0
        and data["bolt"]["factor_supply"] > 1.0
    )
    most = {row["joint"]: row["most_nm"] for row in data["joints"]}
    assert [most[j] for j in ("m6", "m8", "m10")] == pytest.approx([12, 22, 38], rel=0.05)


def test_the_coupler_lowers_the_measured_peaks(load: tuple[Path, dict]) -> None:
    peak = {(row["load"], row["coupler"]): row["torque_peak_nm"] for row in load[1]["coupler"]}
    assert peak["locked", "with"] < 0.85 * peak["locked", "without"]
    assert peak["slip_60", "without"] == pytest.approx(60.0, abs=0.1)
    half, full = load[1]["motion"]
    assert (
        half["torque_peak_nm"] < full["torque_peak_nm"]
        and half["current_mean_a"] < full["current_mean_a"]
    )


def test_disc_springs_by_hand() -> None:
    """DIN EN 16984: no force without deflection; a flat spring carries 4 E / (1 - nu^2) h0 t^3 /
    (K1 De^2), K1 0.69 at De / Di = 2.
    """
    assert disc_force(np.array([0.0]))[0] == 0.0
    assert disc_force(np.array([1.15e-3]))[0] == pytest.approx(
        4 * 206e9 / 0.91 * 1.15e-3 * 1.5e-3**3 / (0.685 * 0.04**2), rel=1e-2
    )


def test_the_cycle_on_the_locked_joint(impact: tuple[Path, dict]) -> None:
    data = impact[1]
    figures = data["figures"]
    assert figures["period_ms"] == pytest.approx(21.0, abs=0.05)
    assert figures["joint_peak_nm"] == pytest.approx(144, abs=2) and figures[
        "hammer_max_mm"
    ] == pytest.approx(10.9, abs=0.05)
    assert figures["hammer_turn_deg"] == pytest.approx(180.0, abs=0.1)  # two lugs a turn
    assert [p["phase"] for p in data["phases"]] == ["blow", "rebound", "over", "return", "stroke"]
    assert data["phases"][0]["start_ms"] == 0.0 and data["phases"][-1]["end_ms"] == pytest.approx(
        figures["period_ms"], abs=0.02
    )
    assert all(
        a["end_ms"] == b["start_ms"]
        for a, b in zip(data["phases"], data["phases"][1:], strict=False)
    )


def test_phases_follow_height_and_motion() -> None:
    t = np.linspace(0.0, 0.02, 401)
    height = 8e-3 * np.sin(np.pi * t / 0.02) ** 2
    lug = np.where(t < 5e-4, 10.0, 0.0)
    found = phases_of(t, lug, height, 4e-3)
    assert [name for name, _, _ in found] == ["blow", "rebound", "over", "return", "stroke"]
    assert found[2][1] == pytest.approx(5e-3, abs=1e-4) and found[3][1] == pytest.approx(
        10e-3, abs=1e-4
    )
    assert found[4][1] == pytest.approx(15e-3, abs=1e-4) and found[-1][2] == pytest.approx(0.02)


def test_a_blow_shrinks_the_step_and_the_cycle_recovers_it(tmp_path: Path) -> None:
    data = made(tmp_path, "steps", "--only", "impact")["impact"]
    events = {(row["load"], row["event"]): row for row in data["events"]}
    for joint in ("locked", "slip_60", "hard_joint"):
        blow = events[joint, "lug meets the lug ahead"]
        assert blow["smallest_after_s"] < 0.2 * blow["before_s"]
        assert 1e-4 < blow["recovery_s"] < 5e-3
        assert events[joint, "hammer passes the lug height"]["count"] == pytest.approx(
            2 * blow["count"], abs=2
        )
    assert events["slip_60", "joint slips"]["count"] == events["slip_60", "joint sticks"]["count"]
    assert all(
        row["smallest_s"] < row["median_s"] < row["largest_s"] <= 5e-4 for row in data["cycles"]
    )


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("impact", "--rig", ROOT / "rigs/pendulum.toml"), 'kind = "impact"'),
        (("impact", "--joint", "nut"), "--joint must be one of"),
        (("impact", "--duty", "0.05"), "there is no cycle to show"),
        (("supply", "--from", "21", "--to", "14"), "no range"),
        (("load", "--rig", "absent.toml"), "absent.toml"),
        (("steps", "--only", "neither"), "--only must be"),
    ],
)
def test_bad_input_gives_a_message_and_exit_code_2(
    tmp_path: Path, words: tuple, sentence: str
) -> None:
    done = warm_vgroove("study", *words, settings=Settings(cwd=tmp_path))
    assert done.returncode == 2
    assert sentence in " ".join(done.stderr.split()) and "Traceback" not in done.stderr
    assert not list(tmp_path.rglob("*.*"))


def test_a_users_rig_on_its_own_joint(tmp_path: Path) -> None:
    text = (
        (ROOT / "rigs/impact_driver.toml")
        .read_text()
        .replace("voltage_v = 18.5", "voltage_v = 17.0")
    )
    (tmp_path / "rig.toml").write_text(text)
    data = made(tmp_path, "impact", "--rig", "rig.toml", "--joint", "rig")
    assert data["supply_v"] == 17.0 and data["load"]["slip_slope_nm_per_rad"] == 700
    assert data["figures"]["current_mean_a"] < 30.0


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("supply", ("clean blows in %", "lag screw M8")),
        ("load", ("slip torque in N m", "DIN EN 16984")),
        ("impact", ("hammer in mm", "lug height")),
    ],
)
def test_browsers_draw_the_pages(name: str, words: tuple, request: pytest.FixtureRequest) -> None:
    text = seen(request.getfixturevalue(name)[0] / f"{name}.html").dom
    assert len(re.findall(r'<svg[^>]*class="main-svg"', text)) >= 2
    assert all(word in text for word in words)


@pytest.mark.parametrize("study", [["load"], ["steps", "--only", "impact"]])
def test_a_tool_that_does_not_hammer_has_no_cycle_to_show(study: list[str], tmp_path: Path) -> None:
    weak = read_rig(ROOT / "rigs/impact_driver.toml").with_values({"supply.voltage_v": 4.0})
    write_rig(weak, tmp_path / "rig.toml")
    option = "--impact-rig" if study[0] == "steps" else "--rig"
    done = vgroove("study", *study, option, "rig.toml", "-o", "out", cwd=tmp_path)
    assert done.returncode == 2 and "fewer than three blows" in done.stderr
    assert "Traceback" not in done.stderr and not list((tmp_path / "out").glob("*"))
