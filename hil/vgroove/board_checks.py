"""Checks of logs for a run on a board: before the run, of the earlier logs that are diagnosed
together with its log; after the run, of the recorded log.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from vgroove.errors import VgrooveError
from vgroove.log import read_log
from vgroove.rig import Rig, read_rig


@dataclass(frozen=True)
class BoardChecks:
    """The rig that the logs are checked with (None: without a simulation), and earlier logs."""

    rig: Rig | None = None
    earlier: Sequence[Path] = ()

    @classmethod
    def of(cls, rig: Path | None, earlier: Sequence[Path]) -> "BoardChecks":
        """The checks of options; VgrooveError for an unusable rig, for a log that a diagnosis would
        refuse, and for logs without a rig.
        """
        from vgroove.gap.log_check import checked_logs

        if rig is None:
            if earlier:
                raise VgrooveError("--log names logs that are checked with a rig: add --rig RIG")
            return cls()
        checks = cls(read_rig(rig), tuple(earlier))
        checked_logs([read_log(path) for path in earlier], checks.rig)
        return checks

    def warnings_of(self, recorded: Path) -> list[str]:
        """Warnings of a recorded log, to be diagnosed with the earlier ones; VgrooveError for one
        that a diagnosis would refuse, which is kept.
        """
        from vgroove.gap.log_check import check_log

        check = check_log(read_log(recorded), self.rig)
        refusals = [finding.text for finding in check.findings if finding.refuses]
        if refusals:
            raise VgrooveError(
                f"{recorded}: is recorded, but a diagnosis would refuse it: {'; '.join(refusals)}"
            )
        return [f"{recorded}: {finding.text}" for finding in check.findings]
