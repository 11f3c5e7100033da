"""Remarks on subsystems that have a share of the gap but no named effect."""

from collections.abc import Mapping, Sequence

from vgroove.gap.catalogue import BY_ID
from vgroove.gap.verdict.location import UNEXPLAINED

MIN_SHARE = 0.05  # of the squared gap: a smaller share needs no reason (chosen)


def unnamed_share_remarks(share: Mapping[str, float], named: Sequence[str]) -> list[str]:
    """One sentence for each subsystem with a share (docs/spec/gap.md, section 5, `where`) of which
    no effect is named; none where the verdict names nothing.
    """
    owners = {BY_ID[id_].subsystem for id_ in named} | {UNEXPLAINED}
    found = {s: v for s, v in share.items() if v >= MIN_SHARE and s not in owners}
    if not named:
        return []
    return [
        f"where: {subsystem} has {100 * value:.0f} % of the gap and none of the named effects. A "
        "combination of its effects reduces the held-out gap by that share beside the named ones; "
        "no single effect of it is established. It is an error in the form of a named effect, or a "
        "small effect that this log does not determine"
        for subsystem, value in sorted(found.items(), key=lambda item: -item[1])
    ]
