"""The measured EMPS axis: the ladder of force errors and the published parameters, as the data's
README states them.
"""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from vgroove.cli import app
from vgroove.errors import VgrooveError
from vgroove.gap.emps import PUBLISHED, emps_figures

EMPS = Path(__file__).resolve().parents[1] / "data/emps"
# model: in sample %, held-out thirds %, free run mm/s (README of the data)
TABLE = {
    "M": (69.6, 69.6, 56.4),
    "+ viscous": (18.0, 18.1, 9.3),
    "+ Coulomb": (7.3, 7.6, 4.5),
    "+ offset": (4.4, 4.5, 2.0),
    "+ directional viscous": (3.5, 3.5, 1.0),
    "the same without the offset": (3.5, 3.6, None),
}
LAST = {
    "M": 95.1,
    "+ Coulomb": 20.24,
    "+ offset": -3.17,
    "+ directional viscous": -36.8,
    "the same without the offset": -39.3,
}


def test_the_errors_of_the_nested_models_are_the_readmes(tmp_path: Path) -> None:
    result = CliRunner().invoke(
        app, ["gap", "emps", str(EMPS), "--json", str(tmp_path / "emps.json")]
    )
    assert result.exit_code == 0 and "95.1089" in result.stdout
    figures = json.loads((tmp_path / "emps.json").read_text())
    assert [entry["model"] for entry in figures["ladder"]] == list(TABLE)
    for entry in figures["ladder"]:
        in_sample, held_out, free_run = TABLE[entry["model"]]
        assert 100 * entry["in_sample"] == pytest.approx(in_sample, abs=0.2)
        assert 100 * entry["held_out"] == pytest.approx(held_out, abs=0.2)
        if free_run is not None:
            assert 1000 * entry["free_run_m_per_s"] == pytest.approx(free_run, rel=0.05)
        if entry["model"] in LAST:
            assert entry["parameters"][entry["last"]] == pytest.approx(
                LAST[entry["model"]], rel=0.005
            )


def test_the_offset_model_has_the_published_parameters() -> None:
    figures = emps_figures(EMPS)
    assert set(figures["published"]) == set(PUBLISHED)
    for row in figures["published"].values():
        assert row["value"] == pytest.approx(row["published"], rel=0.02)


def test_a_log_without_position_is_refused(tmp_path: Path) -> None:
    rows = "\n".join(f"{k * 1e-3:.3f},{k % 7},{k % 5}" for k in range(2000))
    (tmp_path / "log.csv").write_text("time_s,current_a,speed_rpm\n" + rows + "\n")
    (tmp_path / "rig.toml").write_text(
        (Path(__file__).resolve().parents[2] / "rigs/impact_driver_drive.toml").read_text()
    )
    with pytest.raises(VgrooveError, match="position_rad"):
        emps_figures(tmp_path)
