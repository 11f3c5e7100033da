"""Whether the command of a row acts before the row or after it, estimated from the simulation."""

from dataclasses import replace

from vgroove.gap.log_check.facts import LogFacts
from vgroove.gap.log_check.finding import Finding
from vgroove.gap.log_check.nominal import first_rows, is_simulated, mean_error, nominal_pairs
from vgroove.log import Log
from vgroove.rig import Rig

# Share of the simulation's error that may be left with the better convention, and the largest
# error with it, to name it (chosen): an unmodelled effect changes the errors as well
DECIDES, MAX_ERROR = 0.8, 0.1


def convention_of(log: Log, rig: Rig) -> tuple[str, str]:
    """Convention of the command (interval, instant or unknown) and the reason in words: that with
    the smaller error of the simulated signals.
    """
    if not is_simulated(rig):
        return "unknown", "the plant is not driven by a log of this rig"
    part = first_rows(log, rig)
    before, after = (_error(part, rig, hold) for hold in ("before", "after"))
    reason = f"relative error {before:.3g} as intervals, {after:.3g} as instants"
    best = min(before, after)
    if best > MAX_ERROR or best > DECIDES * max(before, after):
        return "unknown", reason + ": that does not decide"
    return ("interval" if before < after else "instant"), reason


def _error(log: Log, rig: Rig, hold: str) -> float:
    """Mean relative error of the nominal signals with one convention."""
    held = replace(rig, input={**rig.input, "hold": hold})
    return mean_error(nominal_pairs(log, held))


def with_convention(facts: LogFacts, log: Log, rig: Rig) -> tuple[LogFacts, list[Finding]]:
    """The facts with the convention of the command, and a remark where it is not the rig's."""
    rows, reason = convention_of(log, rig)
    facts = replace(facts, command_rows=rows, command_rows_reason=reason)
    stated = "instant" if rig.command_holds_after else "interval"
    if rows in ("unknown", stated):
        return facts, []
    hold = "after" if rows == "instant" else "before"
    text = (
        f"the rows look like {rows}s ({reason}): if the logger writes so, put "
        f'hold = "{hold}" into [input] of the rig'
    )
    return facts, [Finding(text)]
