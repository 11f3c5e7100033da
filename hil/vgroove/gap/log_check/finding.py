"""What a check of a log finds."""

import re
from dataclasses import asdict, dataclass, replace
from typing import Any

from vgroove.errors import VgrooveError
from vgroove.gap.log_check.facts import LogFacts
from vgroove.log import Log
from vgroove.log.units_of_columns import own_unit, unit_factor

SCHEMA = "vgroove.log_check/2"


@dataclass(frozen=True)
class Finding:
    """A sentence about a log. refuses: the log must not be used as it is; warns: the sentence is a
    warning of every command that reads the log.
    """

    text: str
    refuses: bool = False
    warns: bool = False

    def with_names(self, log: Log) -> "Finding":
        """The finding whose proposed --map options name the columns as the file does, and state
        what one of the file's numbers is, where these are in another unit than the log's.
        """
        text = self.text
        for column, scale in log.scales.items():
            pattern = rf'(--map "{column}:)([^"=]*)(={column}")'
            text = re.sub(pattern, lambda m, c=column, s=scale: _scaled(m, c, s), text)
        for column, name in log.read_from.items():
            text = text.replace(f'--map "{column}:', f'--map "{name}:')
        return replace(self, text=text)


def _scaled(option: re.Match[str], column: str, scale: tuple[float, float]) -> str:
    """An option that states a unit of the log's numbers, as one of the file's; as it is where it
    leaves the factor open.
    """
    factor, zero = scale
    try:
        factor *= unit_factor(option[2], column)
    except VgrooveError:
        return option[0]
    unit = f"{factor:.7g} {own_unit(column)}".strip() + (f" from {zero:.7g}" if zero else "")
    return f"{option[1]}{unit}{option[3]}"


@dataclass(frozen=True)
class LogCheck:
    """Facts and findings of one log."""

    facts: LogFacts
    findings: list[Finding]

    @property
    def refused(self) -> bool:
        """Whether there is a finding against the use of the log."""
        return any(finding.refuses for finding in self.findings)

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "schema": SCHEMA,
            **asdict(self.facts),
            "refused": self.refused,
            "findings": [asdict(finding) for finding in self.findings],
        }
