"""The firmware passes its linters, and the linters find violations in test code."""

import shutil
from pathlib import Path

import lint_firmware
import pytest

TOOLS = all(shutil.which(tool) for tool in ("clang-tidy", "cppcheck"))
needs_tools = pytest.mark.skipif(not TOOLS, reason="clang-tidy and cppcheck are not installed")


def test_switches_dispatcher_and_includes_keep_their_rules() -> None:
    assert lint_firmware.structure() == []


def test_a_default_label_is_found() -> None:
    text = "switch (a) {\ncase A:\n    break;\ndefault :\n    break;\n}\n"
    assert lint_firmware.switch_defaults("x.c", text) == [
        "x.c:4: default: in a switch; list all enumerators"
    ]
    for harmless in (
        "// default: none\n",
        'puts("default: 1");',
        "/* default:\n */",
        "x_default: 1",
    ):
        assert lint_firmware.switch_defaults("x.c", harmless) == []


def test_a_controller_in_the_dispatcher_is_found() -> None:
    names = lint_firmware.listed_controllers("    X(DRILL, drill, Drill, CONTROL_BOTH,\n      P)\n")
    assert names == {"DRILL", "drill", "Drill"}
    for text in ("self->set.drill.pulse = 0;", "mode != TELEMETRY_MODE_DRILL", "drill_step(self);",
                 "const DrillSetpoints *set;"):  # fmt: skip
        assert len(lint_firmware.named_controllers("x.c", text, names)) == 1, text
    assert lint_firmware.named_controllers("x.c", "drilling(); // DRILL", names) == []


def test_modules_that_include_each_other_are_found() -> None:
    assert lint_firmware.include_cycles({"a": {"b"}, "b": {"c"}, "c": {"d"}, "d": set()}) == []
    assert lint_firmware.include_cycles({"a": {"b"}, "b": {"c"}, "c": {"b"}}) == [
        "b and c include each other"
    ]
    assert len(lint_firmware.include_cycles({"a": {"b"}, "b": {"c"}, "c": {"a"}})) == 3


@needs_tools
def test_firmware_is_clean() -> None:
    found = lint_firmware.findings()
    assert not found, "\n".join(found)


@needs_tools
def test_clang_tidy_finds_a_violation(tmp_path: Path) -> None:
    bad = tmp_path / "bad.c"
    bad.write_text(
        "#include <stdint.h>\nint16_t f(int16_t a);\nint16_t f(int16_t a) {\n"
        "    if (a == 1)\n        return a;\n    return a == a ? 1 : 0;\n}\n"
    )
    found = "\n".join(lint_firmware.tidy(bad))
    assert "braces" in found and "redundant" in found


@needs_tools
def test_cppcheck_finds_a_misra_violation(tmp_path: Path) -> None:
    bad = tmp_path / "bad.c"
    bad.write_text(
        "#include <stdint.h>\nuint8_t f(uint8_t a);\nuint8_t f(uint8_t a) {\n"
        "    goto out;\nout:\n    a = 0x10 + 010;\n    return a;\n}\n"
    )
    assert any("misra-c2012-7.1" in line for line in lint_firmware.cppcheck([bad]))


def test_every_c_file_of_the_firmware_is_linted() -> None:
    linted = {
        *lint_firmware.portable(),
        *lint_firmware.board_sources(),
        *lint_firmware.host_sources(),
    }
    assert {
        path
        for path in lint_firmware.FIRMWARE.rglob("*.c")
        if path.name not in lint_firmware.GENERATED
    } == linted


@needs_tools
def test_board_files_are_checked_as_the_target_builds_them(tmp_path: Path) -> None:
    bad = tmp_path / "bad.c"
    bad.write_text(
        '#include <avr/interrupt.h>\n#include <avr/wdt.h>\n#include "build_hash.h"\n'
        "static volatile uint32_t hash = VGROOVE_BUILD_HASH;\n"
        "ISR(TIMER2_COMPA_vect, ISR_NAKED) {\n    wdt_reset();\n"
        "    if (hash == hash)\n        TCNT2 = 010;\n}\n"
    )
    found = lint_firmware.tidy(bad)
    assert (
        found
        and all("bad.c" in line and "diagnostic-error" not in line for line in found)
        and "braces" in "\n".join(found)
    )
    assert any(
        "misra-c2012-7.1" in line for line in lint_firmware.cppcheck([bad], *lint_firmware.BOARD)
    )


@needs_tools
def test_host_files_are_checked_for_errors(tmp_path: Path) -> None:
    bad = tmp_path / "bad.c"
    bad.write_text("int f(void) {\n    int a[2] = {1, 2};\n    return a[2];\n}\n")
    assert any(
        "arrayIndexOutOfBounds" in line for line in lint_firmware.cppcheck([bad], platform="unix64")
    )


def test_a_suppression_needs_a_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "s.txt"
    file.write_text("10.1:\n")
    monkeypatch.setattr(lint_firmware, "SUPPRESSIONS", file)
    with pytest.raises(SystemExit):
        lint_firmware.suppressed_rules()
