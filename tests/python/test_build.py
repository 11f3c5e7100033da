"""Scripts of the build: the header with the commit's hash is written without output and only when
the hash changes; every configured preset can be built and tested.
"""

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "firmware/build_hash.cmake"


def build_hash(source: Path, output: Path) -> str:
    done = subprocess.run(
        ["cmake", f"-DOUTPUT={output}", f"-DSOURCE={source}", "-P", SCRIPT],
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout + done.stderr == ""
    return output.read_text().splitlines()[1]


def commit(folder: Path, text: str) -> str:
    git = ["git", "-C", str(folder), "-c", "user.name=x", "-c", "user.email=x@x"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", text], check=True)
    return subprocess.run(
        [*git, "rev-parse", "HEAD"], capture_output=True, text=True, check=True
    ).stdout[:6]


@pytest.mark.skipif(
    not (shutil.which("cmake") and shutil.which("git")), reason="cmake and git are needed"
)
def test_the_build_hash_is_the_commits_and_prints_nothing(tmp_path: Path) -> None:
    tree, output = tmp_path / "tree", tmp_path / "build_hash.h"
    tree.mkdir()
    first = commit(tree, "one")
    assert build_hash(tree, output) == f"#define VGROOVE_BUILD_HASH 0x{first}u"
    os.utime(output, (1, 1))
    build_hash(tree, output)
    assert output.stat().st_mtime == 1
    second = commit(tree, "two")
    assert (
        build_hash(tree, output) == f"#define VGROOVE_BUILD_HASH 0x{second}u"
        and second != first
        and output.stat().st_mtime != 1
    )


@pytest.mark.skipif(not shutil.which("cmake"), reason="cmake is needed")
def test_outside_git_the_hash_is_zero(tmp_path: Path) -> None:
    assert (
        build_hash(tmp_path / "none", tmp_path / "build_hash.h")
        == "#define VGROOVE_BUILD_HASH 0x0u"
    )


def test_every_preset_that_is_configured_can_be_built_and_tested() -> None:
    presets = json.loads((ROOT / "CMakePresets.json").read_text(encoding="utf-8"))
    visible = {preset["name"] for preset in presets["configurePresets"] if not preset.get("hidden")}
    assert {preset["name"] for preset in presets["buildPresets"]} == visible
    assert {preset["name"] for preset in presets["testPresets"]} == {"dev", "asan", "coverage"}
