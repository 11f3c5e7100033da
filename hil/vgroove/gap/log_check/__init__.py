"""Checks of a log before a diagnosis: what it holds, and whether its units, signs and time base are
those that the rig expects.

A diagnosis would explain a wrong unit by an effect, or compare nothing at all. The factors between
log and simulation are taken from simulations of the rig without any fit.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.gap.log_check.factors import unit_findings
from vgroove.gap.log_check.facts import LogFacts, facts_of
from vgroove.gap.log_check.finding import Finding, LogCheck
from vgroove.gap.log_check.plausible import plausibility_findings, rate_finding
from vgroove.gap.log_check.row_convention import with_convention
from vgroove.gap.log_check.same_log import refuse_same_log
from vgroove.gap.residual.clean_log import clean_log
from vgroove.gap.residual.impact.impact_run import prepare_impact_run
from vgroove.log import Log
from vgroove.rig import Rig

__all__ = ["Finding", "LogCheck", "LogFacts", "check_log", "checked_logs"]

OVERRIDE = "--as-is, in Python as_is=True, uses the log as it is"


def check_log(log: Log, rig: Rig | None = None) -> LogCheck:
    """Facts and findings of a log, with a rig also those that compare it with its simulation.

    VgrooveError where the column that drives the model is missing or cannot have driven the tool.
    """
    facts, findings = facts_of(log, rig), refusals_and_warnings(log, rig)
    if rig is not None and not any(finding.refuses for finding in findings):
        facts, remarks = with_convention(facts, log, rig)
        findings += remarks + impact_findings(log, rig)
    return LogCheck(facts, findings)


def impact_findings(log: Log, rig: Rig) -> list[Finding]:
    """Warnings of the preparation of a hammering tool's log, or what refuses it."""
    if rig.mechanism["kind"] != "impact":
        return []
    known, source = set(log.warnings), f"{log.source}: "
    try:
        warnings = prepare_impact_run(clean_log(log, rig)).warnings
    except VgrooveError as error:
        return [Finding(str(error).removeprefix(source), refuses=True)]
    return [Finding(w.removeprefix(source), warns=True) for w in warnings if w not in known]


def refusals_and_warnings(log: Log, rig: Rig | None) -> list[Finding]:
    """Findings on the values of a log and, with a rig, on its rate, units and signs."""
    return [finding.with_names(log) for finding in _all_findings(log, rig)]


def _all_findings(log: Log, rig: Rig | None) -> list[Finding]:
    findings = plausibility_findings(log, rig)
    if rig is None:
        return findings
    findings += rate_finding(log, rig)
    if any(finding.refuses for finding in findings):
        return findings
    return findings + unit_findings(log, rig)


def checked_logs(
    logs: Sequence[Any], rig: Rig, as_is: bool = False, joints: Sequence[Rig] = ()
) -> list[Any]:
    """Logs of one tool (vgroove.log.Log or alike) with the warnings of their checks. joints: for
    each log the rig with its own joint (empty: all have the rig's).

    VgrooveError for a log that is given twice and, unless as_is, for one with findings against its
    use; it names all of them.
    """
    refuse_same_log(logs)
    if as_is:
        return list(logs)
    tools = joints or [rig] * len(logs)
    return [_with_warnings(log, tool) for log, tool in zip(logs, tools, strict=True)]


def _with_warnings(log: Any, rig: Rig) -> Any:
    """A log with the warnings of its check; VgrooveError where a finding refuses it."""
    columns = {name: np.asarray(values, float) for name, values in log.columns.items()}
    table = Log(np.asarray(log.time_s, float), columns, log.source)
    if isinstance(log, Log):
        table = replace(table, read_from=log.read_from, scales=log.scales)
    findings = refusals_and_warnings(table, rig)
    refusals = [finding.text for finding in findings if finding.refuses]
    if refusals:
        raise VgrooveError(f"{log.source}: {'; '.join(refusals)} ({OVERRIDE})")
    warnings = [f"{log.source}: {finding.text}" for finding in findings if finding.warns]
    return replace(log, warnings=[*log.warnings, *warnings]) if warnings else log
