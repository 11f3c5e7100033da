"""Cases with the firmware in the loop on the generator's impact tool: the assumed firmware repeats
the log of a plant gap bit by bit, and not that of a firmware gap.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from vgroove.rig import read_rig

FOLDER = Path(__file__).resolve().parents[1] / "firmware_gap"
if str(FOLDER) not in sys.path:
    sys.path.insert(0, str(FOLDER))

import firmware_bench  # noqa: E402
from firmware_runs import Deviation, FirmwareRun, first_difference  # noqa: E402

ENTRIES = firmware_bench.firmware_plan("tune")


def case_of(kind: str, what: str) -> firmware_bench.FirmwareCase:
    """The first case of a kind in the half tune."""
    return firmware_bench.draw_case(next(e for e in ENTRIES if (e.kind, e.what) == (kind, what)))


def test_the_assumed_firmware_repeats_a_log_without_a_firmware_gap() -> None:
    case = case_of("none", "")
    assert first_difference(case.run, case.plan, Deviation()) is None
    assert len(case.run.rows["duty"]) > 1000
    assert np.max(case.run.rows["blow_count"]) > 10


def test_a_changed_input_is_found_at_its_row() -> None:
    case = case_of("none", "")
    rows = {name: values.copy() for name, values in case.run.rows.items()}
    rows["duty"][700] += 1.0 / 255.0
    changed = FirmwareRun(rows, case.run.inputs)
    found = first_difference(changed, case.plan, Deviation())
    assert found == pytest.approx(rows["time_s"][700])


@pytest.mark.parametrize("what", firmware_bench.DEVIATIONS)
def test_a_firmware_gap_has_a_first_row(what: str) -> None:
    case = case_of("firmware", what)
    assert case.first_s is not None and 0.05 < case.first_s < case.plan.seconds
    answer = firmware_bench.answer_of(case)
    assert answer["label"] == "firmware" and what in answer["accept_what"]


def test_a_case_is_the_same_whenever_it_is_made(tmp_path: Path) -> None:
    entry = next(e for e in ENTRIES if e.kind == "firmware")
    for folder in ("a", "b"):
        firmware_bench.write_case(firmware_bench.draw_case(entry), tmp_path / folder)
    for name in ("log.csv", "rig.toml", "firmware.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert read_rig(tmp_path / "a/rig.toml").mechanism["kind"] == "impact"
    assert json.loads((tmp_path / "a/firmware.json").read_text())["mode"] == entry.mode


def test_plan_has_every_mode_and_deviation_in_each_half() -> None:
    for half in ("tune", "report"):
        entries = firmware_bench.firmware_plan(half)
        firmware = [e for e in entries if e.kind == "firmware"]
        assert {(e.mode, e.what) for e in firmware} == {
            (mode, what) for mode in firmware_bench.MODES for what in firmware_bench.DEVIATIONS
        }
