"""Every C and C++ file is laid out as .clang-format says; the check is itself tried on a file that
is not.
"""

import shutil
from pathlib import Path

import layout
import pytest

pytestmark = pytest.mark.skipif(
    not shutil.which("clang-format"), reason="clang-format is not installed"
)


def test_files_are_formatted() -> None:
    left = set(layout.unformatted(layout.written_by_hand()))
    wrong = left - set(layout.listed())
    assert not wrong, "run `python tests/lint/layout.py --fix`: " + ", ".join(sorted(wrong))


def test_the_list_of_files_that_wait_holds_no_others() -> None:
    assert set(layout.listed()) - set(layout.unformatted(layout.listed())) == set()


def test_another_layout_is_caught(tmp_path: Path) -> None:
    good, bad = tmp_path / "good.c", tmp_path / "bad.c"
    good.write_text("int f(int *a) {\n    return *a;  // why\n}\n")
    bad.write_text("int f(int* a)\n{\n  return *a;\n}\n")
    assert layout.unformatted([str(good), str(bad)]) == [str(bad)]
