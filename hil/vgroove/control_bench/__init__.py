"""The instrument that judges the controllers: runs of the real firmware on the plant, and the
tables of `vgroove bench control`.

from vgroove.control_bench import pull, reference, sil_run run = sil_run(reference("slip_60",
supply_v=17.5), mode="sync", params={"SYNC_METHOD": 1}, profile=pull(0.8), duration_s=1.5, seed=3)
run.hits["time_s"], run.hits["kind"]      what really happened, blow by blow
run.telemetry["speed_rpm"]                what the board said run.truth["housing_nm"]
with truth_every=1: the tool at 31,372.5 Hz
"""

from vgroove.control_bench.runs import AbsentError, Run, pull, reference, sil_run

__all__ = ["AbsentError", "Run", "pull", "reference", "sil_run"]
