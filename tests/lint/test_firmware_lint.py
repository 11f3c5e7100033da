"""The firmware passes its linters, and the linters are themselves tried on code that breaks their
rules.
"""

import shutil
from pathlib import Path

import lint_firmware
import pytest

TOOLS = all(shutil.which(tool) for tool in ("clang-tidy", "cppcheck"))
pytestmark = pytest.mark.skipif(not TOOLS, reason="clang-tidy and cppcheck are not installed")


def test_firmware_is_clean() -> None:
    found = lint_firmware.findings()
    assert not found, "\n".join(found)


def test_clang_tidy_catches(tmp_path: Path) -> None:
    bad = tmp_path / "bad.c"
    bad.write_text(
        "#include <stdint.h>\nint16_t f(int16_t a);\nint16_t f(int16_t a) {\n"
        "    if (a == 1)\n        return a;\n    return a == a ? 1 : 0;\n}\n"
    )
    found = "\n".join(lint_firmware.tidy(bad))
    assert "braces" in found and "redundant" in found


def test_cppcheck_catches_misra(tmp_path: Path) -> None:
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


def test_the_boards_files_are_seen_as_the_board_builds_them(tmp_path: Path) -> None:
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


def test_what_only_the_host_builds_is_checked_for_mistakes(tmp_path: Path) -> None:
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
