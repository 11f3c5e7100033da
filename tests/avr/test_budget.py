"""The ELFs keep their limits, and the check finds float routines."""

import shutil
import subprocess
from pathlib import Path

import budget
import pytest
from builds import BUILDS


@pytest.mark.parametrize("elf", BUILDS)
def test_elf_keeps_its_budgets(elf: str, request: pytest.FixtureRequest) -> None:
    assert budget.measure(request.getfixturevalue(elf)).broken() == []


@pytest.mark.parametrize("folder", ["avr-uno-hil", "avr-uno-drill-hil"])
def test_builds_for_real_time_runs_keep_their_budgets(folder: str) -> None:
    elf = budget.ROOT / "build" / folder / "vgroove.elf"
    assert elf.is_file(), f"{elf} does not exist: run `make build`"
    assert budget.measure(elf).broken() == []


@pytest.mark.skipif(not shutil.which("avr-gcc"), reason="avr-gcc is not installed")
def test_a_float_division_is_found(tmp_path: Path) -> None:
    source = tmp_path / "f.c"
    source.write_text(
        "volatile float a = 1, b = 2; volatile long c;\n"
        "int main(void) { c = (long)(a / b); for (;;) {} }\n"
    )
    elf = tmp_path / "f.elf"
    subprocess.run(["avr-gcc", "-mmcu=atmega328p", "-Os", str(source), "-o", str(elf)], check=True)
    found = budget.measure(elf).soft_float
    assert "__divsf3" in found and "__fixsfsi" in found


def test_limits_are_exact() -> None:
    assert budget.Budget(budget.FLASH_LIMIT, budget.RAM_LIMIT, ()).broken() == []
    assert (
        len(budget.Budget(budget.FLASH_LIMIT + 1, budget.RAM_LIMIT + 1, ("__addsf3",)).broken())
        == 3
    )


def test_integer_routines_are_no_float() -> None:
    assert (
        budget.soft_float(["__udivmodsi4", "__mulsi3", "__muluhisi3", "__divmodhi4", "main"]) == ()
    )
