"""The controllers' bench: runs of the firmware on the plant, and the tables of `vgroove bench
control`.

A run in Python:

    from vgroove.control_bench import pull, reference, sil_run
    rig = reference("slip_60", supply_v=17.5)
    run = sil_run(rig, mode="sync", params={"SYNC_METHOD": 1}, profile=pull(0.8), seed=3)
    run.hits["time_s"], run.hits["kind"]      blows and repeats of the plant
    run.telemetry["speed_rpm"]                telemetry of the board
    run.truth["housing_nm"]                   states of the plant; needs truth_every=1

Importing this package alone, as every command does, loads neither numpy nor the plant.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from vgroove.control_bench.runs import Run, pull, reference, sil_run
    from vgroove.eeprom_image import AbsentError

__all__ = ["AbsentError", "Run", "pull", "reference", "sil_run"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from vgroove.control_bench import runs

    return getattr(runs, name)
