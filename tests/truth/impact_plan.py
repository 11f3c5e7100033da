"""The plan of the blind set of the impact tool: half, kind, regime, joint and bench channels of
every case, and their order.
"""

import hashlib
from dataclasses import dataclass

import numpy as np
from bench_plan import SETS
from impact_effects import BY_ID, CATALOGUE, DRIVE, EVERYWHERE, MECHANISM, OUTSIDE_IDS, accepted

IMPACT_SEED = 20261125
IMPACT_REGIMES = ("exact", "loose")
IMPACT_SIZES = (1.5, 10.0)  # times the visible limit, with the tolerated keys fitted
# Cases in a half: of each effect of the mechanism exact and loose, of each of the drive in either
# regime, without effect, of each thing outside the catalogue (two exact, one loose), pairs
MECHANISM_EXACT, MECHANISM_LOOSE, NONES, PAIRS = 4, 2, 24, 16
# Pairs that are too similar for one case
TOO_SIMILAR = (frozenset(("speed_lag", "hall_dropout")),)


@dataclass(frozen=True)
class ImpactEntry:
    """A case to draw. Regime `exact`: exact rig, the catalogue's forms; `loose`: tool and joint off
    by stated tolerances, half of the cases in other forms. `bench`: with bench channels.
    """

    set: str
    number: int
    kind: str
    regime: str
    first: str
    joint: str
    bench: bool

    @property
    def name(self) -> str:
        """A hash that reveals nothing about the case."""
        text = f"{IMPACT_SEED} {self.set} {self.number}"
        return hashlib.sha256(text.encode()).hexdigest()[:10]


def impact_plan(half: str) -> list[ImpactEntry]:
    """The cases of a half in a random order, so that the first n are a sample of them."""
    rows = planned_rows(SETS.index(half))
    order = np.random.default_rng([IMPACT_SEED, SETS.index(half)]).permutation(len(rows))
    return [ImpactEntry(half, n, *rows[k]) for n, k in enumerate(order)]


def planned_rows(shift: int) -> list[tuple[str, str, str, str, bool]]:
    """(kind, regime, first effect, joint, bench) of all cases of a half; the halves differ in the
    joints by `shift`.
    """
    drawn: list[tuple[str, str, str, bool]] = []
    for effect in MECHANISM:
        drawn += [("single", "exact", effect.id, n % 2 == 1) for n in range(MECHANISM_EXACT)]
        drawn += [("single", "loose", effect.id, n % 4 == 3) for n in range(MECHANISM_LOOSE)]
    for n, effect in enumerate(DRIVE):
        drawn += [("single", "exact", effect.id, n % 3 == 2), ("single", "loose", effect.id, False)]
    for n in range(NONES):
        drawn.append(("none", IMPACT_REGIMES[n % 2], "", n % 6 >= 4))
    for n, name in enumerate(OUTSIDE_IDS):
        drawn += [("unlisted", "exact", name, n % 2 == 0), ("unlisted", "exact", name, False)]
        drawn.append(("unlisted", "loose", name, False))
    for n in range(PAIRS):
        first = MECHANISM[(n + shift * PAIRS) % len(MECHANISM)].id
        drawn.append(("pair", IMPACT_REGIMES[n % 2], first, n % 6 >= 4))
    out = []
    for n, (kind, regime, first, bench) in enumerate(drawn):
        joints = BY_ID[first].joints if first else EVERYWHERE
        out.append((kind, regime, first, joints[(n + n // 4 + shift) % len(joints)], bench))
    return out


def alike(one: str, other: str) -> bool:
    """Whether two ids are equivalent or too similar for one case."""
    same = set(accepted(BY_ID[one])) & set(accepted(BY_ID[other]))
    return bool(same) or frozenset((one, other)) in TOO_SIMILAR


def impact_partners(entry: ImpactEntry, rng: np.random.Generator) -> list[str]:
    """Ids of a case: the planned one, and for a pair a drawn one that its joint shows too."""
    if entry.kind == "none":
        return []
    if entry.kind != "pair":
        return [entry.first]
    others = [e.id for e in CATALOGUE if entry.joint in e.joints and not alike(entry.first, e.id)]
    return [entry.first, str(rng.choice(others))]
