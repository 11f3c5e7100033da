"""docs/adding_an_effect.md holds: its two edits, applied to a copy of the tree, give the plant the
parameter and the switch, rigs the key, and the torque that the equation states.
"""

import json
import math
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/adding_an_effect.md").read_text(encoding="utf-8")
PARAMETER = "effects.seal_friction.nm_per_root_rad_s"
SPEEDS = (-400.0, -1.0, 1e-6, 25.0, 900.0)  # rad/s
INERTIA_KG_M2 = 2e-5

PROGRAM = """
// Prints for each speed the acceleration with a seal friction and without, in rad/s^2.
#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "drivetrain/model.hpp"

using namespace vgroove;

static double acceleration(double seal, double speed, std::uint32_t &effects) {
    Parameters p;
    p.supply_voltage_v = 18.0;
    p.motor_resistance_ohm = 0.19;
    p.motor_inductance_h = 1e-4;
    p.motor_torque_constant = 0.0109;
    p.motor_inertia_kg_m2 = 2e-5;
    double *theta = reinterpret_cast<double *>(&p);
    for (int n = 0; n < PARAMETER_COUNT; ++n)
        if (std::strcmp(parameter_name(n), "effects.seal_friction.nm_per_root_rad_s") == 0)
            theta[n] = seal;
    check_parameters(p, true);
    Drivetrain<double> m{};
    m.effects = effects = effects_of(p, 0.0);
    m.input = InputKind::DUTY;
    drivetrain_set_lane(m, 0, p, 1.0, 1e-3);
    State<double, STATE_FULL_COUNT> s{};
    s.x[STATE_SPEED] = speed;
    Mode<double> mode{};
    mode.slide = sign_of(speed);
    return drivetrain_derivative<double, STATE_FULL_COUNT>(m, {}, mode, 0.0, s).x[STATE_SPEED];
}

int main(int count, char **words) {
    const double seal = std::atof(words[1]);
    for (int n = 2; n < count; ++n) {
        std::uint32_t on = 0u, off = 0u;
        const double with = acceleration(seal, std::atof(words[n]), on);
        const double without = acceleration(0.0, std::atof(words[n]), off);
        std::printf("%.17g %.17g %d %d\\n", with, without, (on & EFFECT_SEAL_FRICTION) != 0u,
                    (off & EFFECT_SEAL_FRICTION) != 0u);
    }
}
"""
LIST_RIG_KEYS = """
import json, sys
sys.meta_path = [f for f in sys.meta_path if "vgroove" not in type(f).__module__]
sys.path.insert(0, sys.argv[1])
from vgroove import rig_keys
from vgroove.gap.catalogue import BY_ID, listing
key = rig_keys.EFFECTS["seal_friction"]["nm_per_root_rad_s"]
print(json.dumps({"file": rig_keys.__file__, "holds": key.holds(float(sys.argv[2])),
                  "listed": "seal_friction" in listing.markdown_table()}))
"""


def blocks(language: str) -> list[str]:
    """Code blocks of the page in a language."""
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of plant/ and hil/vgroove/ with the page's edits."""
    folder = tmp_path_factory.mktemp("tree")
    unwanted = shutil.ignore_patterns("__pycache__", "*.so")
    shutil.copytree(ROOT / "plant", folder / "plant", ignore=unwanted)
    shutil.copytree(ROOT / "hil/vgroove", folder / "hil/vgroove", ignore=unwanted)
    for edit in blocks("diff"):
        subprocess.run(
            ["git", "apply", "-"], input=edit, text=True, cwd=folder, check=True,
            env={**os.environ, "GIT_CEILING_DIRECTORIES": str(folder.parent)},
        )  # fmt: skip
    return folder


def rig_value() -> float:
    """The parameter of the page's rig."""
    (rig,) = blocks("toml")
    return float(tomllib.loads(rig)["effects"]["seal_friction"]["nm_per_root_rad_s"])


def test_the_page_changes_the_entry_and_the_component_alone() -> None:
    changed = re.findall(r"^\+\+\+ b/(.*)$", "".join(blocks("diff")), re.MULTILINE)
    assert changed == [
        "hil/vgroove/gap/catalogue/motor_mechanical.py",
        "plant/components/friction.hpp",
    ]


def test_rigs_and_pages_have_the_key(tree: Path) -> None:
    command = [sys.executable, "-c", LIST_RIG_KEYS, str(tree / "hil"), str(rig_value())]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert Path(found["file"]).is_relative_to(tree)
    assert found["holds"] and found["listed"]


def test_the_plant_has_row_switch_and_torque(tree: Path) -> None:
    header = tree / "build/effect_parameters.hpp"
    subprocess.run([sys.executable, tree / "plant/generate_effects.py", header], check=True)
    text = header.read_text(encoding="utf-8")
    assert f'"{PARAMETER}"' in text and "EFFECT_SEAL_FRICTION = 1u <<" in text
    program = compiled(tree, header.parent)
    seal = rig_value()
    words = [str(program), repr(seal), *map(repr, SPEEDS)]
    lines = subprocess.run(words, capture_output=True, text=True, check=True).stdout.splitlines()
    for speed, line in zip(SPEEDS, lines, strict=True):
        with_seal, without, on, off = map(float, line.split())
        torque = INERTIA_KG_M2 * (without - with_seal)
        expected = seal * math.copysign(math.sqrt(abs(speed)), speed)
        assert torque == pytest.approx(expected, rel=1e-9, abs=1e-15)
        assert (on, off) == (1.0, 0.0)


def compiled(tree: Path, generated: Path) -> Path:
    """A program of the drivetrain's model alone, without optimisation."""
    source, program = tree / "build/main.cpp", tree / "build/main"
    source.write_text(PROGRAM, encoding="utf-8")
    parts = ("components/effects.cpp", "components/parameters.cpp", "drivetrain/model.cpp")
    compiler = shutil.which("g++") or shutil.which("c++")
    if compiler is None:
        pytest.skip("no C++ compiler")
    subprocess.run(
        [
            compiler, "-std=c++17", "-O0", "-ffp-contract=off", "-Wall", "-Wextra", "-Wno-psabi",
            "-Werror", f"-I{generated}", f"-I{tree / 'plant'}", str(source),
            *(str(tree / "plant" / part) for part in parts), "-o", str(program),
        ],
        check=True,
    )  # fmt: skip
    return program
