"""The firmware passes its linters, and the linters are themselves tried on code that breaks their rules."""

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
    bad.write_text("#include <stdint.h>\nint16_t f(int16_t a);\nint16_t f(int16_t a) {\n"
                   "    if (a == 1)\n        return a;\n    return a == a ? 1 : 0;\n}\n")
    found = "\n".join(lint_firmware.tidy(bad))
    assert "braces" in found and "redundant" in found


def test_cppcheck_catches_misra(tmp_path: Path) -> None:
    bad = tmp_path / "bad.c"
    bad.write_text("#include <stdint.h>\nuint8_t f(uint8_t a);\nuint8_t f(uint8_t a) {\n"
                   "    goto out;\nout:\n    a = 0x10 + 010;\n    return a;\n}\n")
    assert any("misra-c2012-7.1" in line for line in lint_firmware.cppcheck([bad]))


def test_a_suppression_needs_a_reason(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "s.txt"
    file.write_text("10.1:\n")
    monkeypatch.setattr(lint_firmware, "SUPPRESSIONS", file)
    with pytest.raises(SystemExit):
        lint_firmware.suppressed_rules()
