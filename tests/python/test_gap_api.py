"""The public Python API of the diagnosis: cheap to import in any order, and typed."""

import subprocess
import sys

import pytest

import vgroove.gap

HEAVY = ("numpy", "scipy", "plotly", "vgroove.rig", "vgroove.html_page")


def loaded_by(statement: str) -> set[str]:
    """Modules that a fresh interpreter has after a statement."""
    code = f"{statement}; import sys; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stdout.split())


@pytest.mark.parametrize("module", ["vgroove.gap", "vgroove.cli", "vgroove.control_bench"])
def test_importing_it_loads_no_numerical_package(module: str) -> None:
    assert loaded_by(f"import {module}").isdisjoint(HEAVY)


@pytest.mark.parametrize("first", ["vgroove.gap", "vgroove.rig", "vgroove.gap.catalogue"])
def test_the_package_can_be_imported_first_or_second(first: str) -> None:
    assert "vgroove.gap.stages" in loaded_by(f"import {first}; import vgroove.gap.stages")


def test_all_public_names_exist() -> None:
    assert all(hasattr(vgroove.gap, name) for name in vgroove.gap.__all__)
