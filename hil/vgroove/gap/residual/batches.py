"""Cuts batches of parameter sets into parts that fit into memory, a cache and the plant's SIMD
lanes (plant/numeric/lanes.hpp).
"""

from collections.abc import Iterator, Sequence

import numpy as np

LANES = 8  # parameter sets that the plant simulates in parallel; all switch the same effects on


def split_by_size(sizes: Sequence[int], most: int) -> Iterator[slice]:
    """Slices over consecutive items whose sizes add up to `most` or less; an item larger than that
    has a slice of its own.
    """
    first, total = 0, 0
    for at, size in enumerate(sizes):
        if total and total + size > most:
            yield slice(first, at)
            first, total = at, 0
        total += size
    if sizes:
        yield slice(first, len(sizes))


def split_by_structure(structure: np.ndarray, most: int) -> list[np.ndarray]:
    """Indices of the members of a batch in parts of about `most`. Members of equal structure (B, k:
    which effects are switched on) are adjacent, and no group of LANES is split.
    """
    _, kind = np.unique(structure, axis=0, return_inverse=True)
    order = np.argsort(kind, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(kind[order])) + 1)
    lanes = [group[at : at + LANES] for group in groups for at in range(0, len(group), LANES)]
    return [
        np.concatenate(lanes[part]) for part in split_by_size([len(one) for one in lanes], most)
    ]
