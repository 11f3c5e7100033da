"""The rules of the source tree hold for every file, and each is itself tried on a file that breaks
it.
"""

import re
import subprocess
import sys

import pytest
import rules

C_FILES = rules.tracked_files(rules.C_ENDINGS)
PY_FILES = rules.tracked_files({".py"})


def read(path: str) -> str:
    return (rules.ROOT / path).read_text(encoding="utf-8")


def explain(violations: list[rules.Violation]) -> str:
    return "\n".join(f"{v.path}:{v.line}: {v.sentence}" for v in violations)


def test_includes_go_one_way() -> None:
    known = rules.known_headers()
    broken = [v for path in C_FILES for v in rules.include_violations(path, read(path), known)]
    assert not broken, explain(broken)


def test_imports_go_one_way() -> None:
    broken = [v for path in PY_FILES for v in rules.import_violations(path, read(path))]
    assert not broken, explain(broken)


def test_files_open_with_a_sentence() -> None:
    broken = [v for path in C_FILES + PY_FILES for v in rules.missing_opening(path, read(path))]
    assert not broken, explain(broken)


def test_simavr_stays_in_the_bench_tool() -> None:
    broken = [v for path in C_FILES for v in rules.gpl_violations(path, read(path))]
    assert not broken, explain(broken)


def test_gpl_is_said_in_each_file_of_the_bench_tool() -> None:
    files = [path for path in C_FILES if path.startswith("hil/board/")]
    assert files
    assert [
        path for path in files if "SPDX-License-Identifier: GPL-3.0-or-later" not in read(path)
    ] == []
    licence = read("hil/board/COPYING")
    assert (
        "GNU GENERAL PUBLIC LICENSE\n                       Version 3" in licence
        and "END OF TERMS AND CONDITIONS" in licence
    )
    assert "hil/board/COPYING" in read("README.md")


PLACES = re.compile(
    r"(?<![\w.])/(?:work|home|root|srv|mnt|opt|tmp)/\w"
    r"|\b(?:10|127|192\.168)\.\d+\.\d+\.\d+\b|index[-]url"
)


def test_no_file_names_a_place_on_somebodys_machine() -> None:
    texts = rules.repository_files()
    if not texts:
        pytest.skip("not in a git work tree")
    found = [
        f"{path}: {match.group()}"
        for path, text in texts.items()
        for match in PLACES.finditer(text)
    ]
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "see /" + "work/main",
        "cd /" + "home/me",
        "http://10" + ".1.2.3/simple",
        "--index" + "-url x",
    ],
)
def test_a_place_is_caught(text: str) -> None:
    assert PLACES.search(text) and not PLACES.search(
        "the work/home/root of 3.14/opt/x, /dev/ttyACM0, ../shared/tmp/x"
    )


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ("firmware/core/x.c", '#include "hal/hal.h"'),
        ("firmware/controllers/x.c", '#include "drivers/h_bridge.h"'),
        ("firmware/telemetry/x.c", '#include "app/app.h"'),
        ("plant/components/x.cpp", '#include "hal/hal.h"'),
        ("plant/x.cpp", '#include "components/motor.hpp"'),
        ("plant/numeric/x.hpp", '#include "components/motor.hpp"'),
        ("plant/components/x.hpp", '#include "drivetrain/model.hpp"'),
        ("plant/drivetrain/x.hpp", '#include "impact/log.hpp"'),
        ("plant/drill/x.hpp", '#include "drivetrain/model.hpp"'),
        ("plant/impact/x.hpp", '#include "lockstep/impact_plant.hpp"'),
        ("tests/truth/x.cpp", '#include "plant/components/motor.hpp"'),
    ],
)
def test_the_include_rule_catches(path: str, line: str) -> None:
    known = {
        "hal/hal.h": "firmware/hal/hal.h",
        "drivers/h_bridge.h": "firmware/drivers/h_bridge.h",
        "app/app.h": "firmware/app/app.h",
        "components/motor.hpp": "plant/components/motor.hpp",
        "plant/components/motor.hpp": "plant/components/motor.hpp",
        "drivetrain/model.hpp": "plant/drivetrain/model.hpp",
        "impact/log.hpp": "plant/impact/log.hpp",
        "lockstep/impact_plant.hpp": "plant/lockstep/impact_plant.hpp",
    }
    assert len(rules.include_violations(path, line, known)) == 1
    assert rules.include_violations("tests/unit/x.cpp", line, known) == []


def test_the_other_rules_catch() -> None:
    long_c = "static void f(void) {\n" + "    x();\n" * 60 + "}\n"
    long_py = "def f():\n" + "    x()\n" * 61
    assert rules.long_c_functions("a.c", long_c) and not rules.long_c_functions(
        "a.c", long_c.replace("    x();\n" * 5, "", 1)
    )
    assert rules.long_python_functions("a.py", long_py)
    assert rules.import_violations("tests/truth/a.py", "import vgroove.rig")
    assert rules.import_violations("hil/vgroove/a.py", "from truth import x")
    assert rules.missing_opening("a.c", "#include <stdint.h>\n") and not rules.missing_opening(
        "a.c", "// What it is for.\n"
    )
    simavr = "#include <simavr/sim_avr.h>"
    assert rules.gpl_violations("plant/a.cpp", simavr) and not rules.gpl_violations(
        "hil/board/a.c", simavr
    )


@pytest.mark.parametrize(
    ("around", "signature"),
    [
        ("", "static void f(int16_t a,\n              int16_t b) {"),
        ("", "void\nf(void)\n{"),
        ("", "T C::f(int a) const noexcept {"),
        ("", "C::C(int a)\n    : a_(a), b_{1}, c_(a ? 1 : 2) {"),
        ("", "template <class V, int N>\nV f(const V &a = V(1),\n    int b = 2) {"),
        ("", "bool operator==(const A &a, const A &b) {"),
        ("", "struct A f(int a) {"),
        ("", "auto f(int a) -> int {"),
        ("", "TEST(Suite, Name) {"),
        ("", "ISR(TIMER2_COMPA_vect) {"),
        ("namespace a {\nclass B {\npublic:\n", "    int f(int a) override {"),
        ('extern "C" {\n', "int f() {"),
    ],
)
def test_a_long_c_function_is_found_however_it_is_written(around: str, signature: str) -> None:
    body = "    if (x) {  // }\n        y(\"}\", '{');\n    }\n" * 18
    fill = 60 - 54 - len(signature.split("\n")) - 1
    for more, found in ((0, 0), (1, 1)):
        text = (
            around
            + signature
            + "\n"
            + body
            + "    z();\n" * (fill + more)
            + "}\n" * (1 + around.count("{"))
        )
        assert len(rules.long_c_functions("a.cpp", text)) == found, text


def test_long_data_is_no_long_function() -> None:
    for head in (
        "static const int TABLE[] = {",
        "enum Mode {",
        "struct alignas(16) A {",
        "const A a = make(b) + {",
        "namespace x {",
    ):
        assert rules.long_c_functions("a.cpp", head + "\n" + "    1,\n" * 80 + "};\n") == []


def test_generated_files_are_up_to_date() -> None:
    generator = rules.ROOT / "firmware/telemetry/generate.py"
    done = subprocess.run([sys.executable, generator, "--check"], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
