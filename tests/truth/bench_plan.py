"""The plan of the blind set: half, kind and regime of every case, and their order."""

import hashlib
from dataclasses import dataclass

import numpy as np
from effects import BY_ID, CATALOGUE, OUTSIDE_IDS, accepted

SEED = 20261121
SETS = ("tune", "report")
PER_EFFECT, NONES, PAIRS, TRIPLES, OUTSIDE = 20, 300, 150, 40, 100
# Cases of the regime `measured` in a series of a half: singles, pairs, disturbances alone. Verdicts
# on a series that was reported have been read: a later report needs a new one
MEASURED = {"single": 100, "pair": 50, "disturbances": 50}
MEASURED_SERIES = 2
REGIMES = ("exact", "hard", "measured")
SIZES = {
    "exact": (3.0, 10.0),
    "hard": (1.5, 10.0),
    "measured": (1.5, 10.0),
}  # times the visible limit, with the tolerated keys fitted
# Pairs that are too similar for one case
TOO_SIMILAR = (
    frozenset(("coulomb_friction", "asymmetric_friction")),
    frozenset(("speed_lag", "hall_dropout")),
)


@dataclass(frozen=True)
class Entry:
    """A case to draw. Regime `exact`: exact rig, the catalogue's forms, 3 to 10 visible limits;
    `hard`: rig off by its tolerances, other forms, 1.5 to 10 visible limits; `measured`: as `hard`,
    half of the cases in the catalogue's forms, with disturbances of zero mean.
    """

    set: str
    number: int
    kind: str
    regime: str
    first: str

    @property
    def name(self) -> str:
        """A hash that reveals nothing about the case."""
        return hashlib.sha256(f"{SEED} {self.set} {self.number}".encode()).hexdigest()[:10]


def plan(half: str) -> list[Entry]:
    """The cases of a half: those of the regimes `exact` and `hard` in a random order, so that the
    first n are a sample of them, and after them each series of `measured` in a random order of its
    own.
    """
    entries = simulated_plan(half)
    for series in range(MEASURED_SERIES):
        entries += measured_plan(half, len(entries), series)
    return entries


def measured_plan(half: str, first: int, series: int) -> list[Entry]:
    """The cases of one series (0, 1, ...) of the regime `measured` in a half, from number `first`.
    In the two halves of a series together all effects have nearly equally many cases.
    """
    kinds = []
    for kind, count in MEASURED.items():
        begin = (len(SETS) * series + SETS.index(half)) * count
        kinds += [
            (kind, "" if kind == "disturbances" else CATALOGUE[n % len(CATALOGUE)].id)
            for n in range(begin, begin + count)
        ]
    order = np.random.default_rng([SEED, SETS.index(half), 3, series]).permutation(len(kinds))
    return [
        Entry(half, first + n, kinds[k][0], "measured", kinds[k][1]) for n, k in enumerate(order)
    ]


def simulated_plan(half: str) -> list[Entry]:
    """The cases of the regimes `exact` and `hard`."""
    kinds: list[tuple[str, str, str]] = []
    for effect in CATALOGUE:
        kinds += [("single", ("exact", "hard")[n % 2], effect.id) for n in range(PER_EFFECT // 2)]
    kinds += [("none", ("exact", "hard")[n % 2], "") for n in range(NONES // 2)]
    kinds += [
        ("pair", ("exact", "hard")[n % 2], CATALOGUE[n % len(CATALOGUE)].id)
        for n in range(PAIRS // 2)
    ]
    kinds += [
        ("triple", "hard", CATALOGUE[(3 * n) % len(CATALOGUE)].id) for n in range(TRIPLES // 2)
    ]
    kinds += [
        (
            "unlisted",
            ("exact", "hard")[n // len(OUTSIDE_IDS) % 2],
            OUTSIDE_IDS[n % len(OUTSIDE_IDS)],
        )
        for n in range(OUTSIDE // 2)
    ]
    order = np.random.default_rng([SEED, SETS.index(half)]).permutation(len(kinds))
    return [Entry(half, n, *kinds[k]) for n, k in enumerate(order)]


def alike(one: str, other: str) -> bool:
    """Whether two ids are equivalent or too similar for one case."""
    return (
        bool(set(accepted(BY_ID[one], True)) & set(accepted(BY_ID[other], True)))
        or frozenset((one, other)) in TOO_SIMILAR
    )


def partners(entry: Entry, rng: np.random.Generator) -> list[str]:
    """Ids of a case: the planned one, and for pairs and triples drawn ones that differ from it."""
    if entry.kind in ("none", "disturbances"):
        return []
    ids = [entry.first]
    while len(ids) < {"pair": 2, "triple": 3}.get(entry.kind, 1):
        other = str(rng.choice([effect.id for effect in CATALOGUE]))
        ids += [] if any(alike(i, other) for i in ids) else [other]
    return ids
