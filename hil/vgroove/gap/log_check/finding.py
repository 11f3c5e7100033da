"""What a check of a log finds."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from vgroove.gap.log_check.facts import LogFacts

SCHEMA = "vgroove.log_check/2"


@dataclass(frozen=True)
class Finding:
    """A sentence about a log. refuses: the log must not be used as it is; warns: the sentence is a
    warning of every command that reads the log.
    """

    text: str
    refuses: bool = False
    warns: bool = False

    def with_names(self, read_from: Mapping[str, str]) -> "Finding":
        """The finding whose proposed --map options name the columns as the file does."""
        text = self.text
        for column, name in read_from.items():
            text = text.replace(f'--map "{column}:', f'--map "{name}:')
        return replace(self, text=text)


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
