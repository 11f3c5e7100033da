"""The demo as a user runs it ends with a right verdict, and its comparison of verdict and answer is
strict.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE), str(HERE.parent / "truth")]

import demo  # noqa: E402

from vgroove.board import default_elf  # noqa: E402

SIM_RELATIVE = {"drive": 0.01, "impact": 0.02}  # of `vgroove sim` against the verdict
EFFECT = {
    "label": "effect",
    "ids": ["bridge_resistance"],
    "accept": [["bridge_resistance", "winding_resistance"]],
}


def verdict(kind: str, *ids: str) -> dict:
    return {"verdict": kind, "selected": list(ids)}


def test_an_indistinguishable_effect_is_right_and_any_other_is_wrong() -> None:
    assert demo.is_right(verdict("effect", "winding_resistance"), EFFECT)
    assert not demo.is_right(verdict("effect", "winding_resistance", "brush_drop"), EFFECT)
    assert not demo.is_right(verdict("effect", "brush_drop"), EFFECT)
    assert not demo.is_right(verdict("ambiguous", "winding_resistance"), EFFECT)
    assert not demo.is_right(verdict("none"), EFFECT)


@pytest.mark.parametrize("label", ["none", "unlisted"])
def test_a_tool_without_a_catalogued_effect_needs_the_verdict_of_its_kind(label: str) -> None:
    answer = {"label": label, "ids": [], "accept": []}
    assert demo.is_right(verdict(label), answer)
    assert not demo.is_right(verdict("effect", "brush_drop"), answer)
    assert not demo.is_right(verdict("unlisted" if label == "none" else "none"), answer)


@pytest.mark.parametrize("tool", ["impact", pytest.param("drive", marks=pytest.mark.proof)])
def test_demo_names_the_sealed_effect(
    tool: str, tmp_path: Path, simulated_gap: Callable[[Path, Path], float]
) -> None:
    elf = Path(os.environ.get("VGROOVE_ELF", default_elf("uno")))
    if not elf.is_file():
        pytest.skip(f"no firmware at {elf}: make build")
    done = subprocess.run(
        [
            sys.executable,
            str(HERE / "demo.py"),
            "--tool",
            tool,
            "--elf",
            str(elf),
            "--out",
            str(tmp_path),
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    result = json.loads((tmp_path / "demo.json").read_text())
    assert result["right"], done.stdout
    assert result["gap"]["after"] < 1.2 < result["gap"]["before"]
    order = [
        done.stdout.index(text) for text in ("SHA-256", "The missing effect", "The seal is opened")
    ]
    assert order == sorted(order)
    assert (tmp_path / "report.html").is_file()
    stated = json.loads((tmp_path / "verdict.json").read_text())["gap"]
    rigs = {"before": HERE / demo.TOOLS[tool][0], "refit": tmp_path / "rig_corrected.toml"}
    for figure, rig in rigs.items():
        found = simulated_gap(rig, tmp_path / "run.csv")
        assert found == pytest.approx(stated[figure], rel=SIM_RELATIVE[tool]), figure
