"""Whether an impact case is what its label says, and the effects of the catalogue that cannot be
distinguished from the truth on its log.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from impact_cases import ImpactCase, ImpactSetting, UnsuitableDraw, effect_params
from impact_effects import BY_ID, CATALOGUE, ImpactEffect, accepted
from impact_visible import (
    Reference,
    change,
    groups,
    largest,
    reference_of,
    remainder,
    strength,
    sure_squares,
    with_tolerance,
)

RIVAL_SEEDS = 6  # runs of a comparison with rivals
# Share of the squared gap that the catalogue's form of an effect must explain
MIN_EXPLAINED = 0.75
# Share of the squared gap of a case outside the catalogue that any single effect may explain
MAX_EXPLAINED_OUTSIDE = 0.6
# Visibility of what a rival leaves, below which it cannot be distinguished from the truth
INVISIBLE = 0.5
# Share of the squared gap that a rival leaves in its linear response, above which it is not
# simulated again
HOPELESS = 0.9
RIVAL_START = 2.0  # size of a rival in its linear response, times its start size


def applicable(effect: ImpactEffect, setting: ImpactSetting) -> bool:
    """Whether joint and profile can show an effect."""
    joint = "locked" if setting.rig.locked else setting.rig.joint
    loosens = bool(setting.profile.duty.min() < 0.0)
    partial = bool(np.any((setting.profile.duty != 0.0) & (np.abs(setting.profile.duty) < 1.0)))
    needs = {"loosen": loosens, "partial": partial or setting.profile.smooth}
    return joint in effect.joints and needs.get(effect.needs, True)


class Fits:
    """Fits of effects to the changes of the statistics of a case."""

    def __init__(self, case: ImpactCase) -> None:
        self.case = case
        self.plain = replace(case.setting, other_forms=False)
        self.reference: Reference = with_tolerance(reference_of(self.plain, RIVAL_SEEDS))
        self.changed = change(self.reference, case.params)
        self.group = groups(self.plain)

    def column(self, effect_id: str, size: float) -> np.ndarray:
        """Change (n,) by an effect in the catalogue's form."""
        return change(self.reference, effect_params(self.plain, effect_id, size))[0]

    def left(self, columns: Sequence[np.ndarray], least: Sequence[float] = ()) -> np.ndarray:
        """Remainder (n,) of a fit of columns (n,)."""
        return remainder(self.reference, self.changed, columns, least)[1]

    def squared(self, left: np.ndarray) -> float:
        """The squared gap of a remainder (n,)."""
        return float(sure_squares(left, self.changed[1]).sum())

    def visible(self, left: np.ndarray) -> float:
        """The visibility of a remainder (n,)."""
        return strength(self.group, left, self.changed[1])

    def rival(self, effect: ImpactEffect, kept: Sequence[np.ndarray]) -> np.ndarray:
        """Remainder (n,) of the fit of a rival beside kept columns; simulated again at the size
        that the linear response gives.
        """
        top = largest(self.plain, effect.id, 1.0)
        size = min(RIVAL_START * effect.start_size(self.plain.tool), top)
        column = self.column(effect.id, size)
        least = [-np.inf] * len(kept) + [-np.inf if effect.signed else 0.0]
        found, left = remainder(self.reference, self.changed, [*kept, column], least)
        again = float(np.clip(found[-1] * size, -largest(self.plain, effect.id, -1.0), top))
        if abs(again) < 0.05 * size or self.squared(left) > HOPELESS * self.squared(
            self.changed[0]
        ):
            return left
        second = self.left([*kept, self.column(effect.id, again)], least)
        return min(left, second, key=self.squared)


def assess(case: ImpactCase) -> None:
    """Raise UnsuitableDraw where the catalogue's form of the truth does not explain the case, where
    a single effect of the catalogue explains a case outside it, or where one of a pair is not
    visible beside the other.
    """
    if case.kind == "none" or (case.kind == "single" and not case.setting.other_forms):
        return
    fits = Fits(case)
    total = fits.squared(fits.left([]))
    if case.kind == "unlisted":
        for effect in (e for e in CATALOGUE if applicable(e, case.setting)):
            explained = 1.0 - fits.squared(fits.rival(effect, [])) / max(total, 1e-9)
            if explained > MAX_EXPLAINED_OUTSIDE:
                raise UnsuitableDraw(f"{list(case.sizes)}: {effect.id} explains {explained:.2f}")
        return
    own = [fits.column(i, size) for i, size in case.sizes.items()]
    explained = 1.0 - fits.squared(fits.left(own)) / max(total, 1e-9)
    if explained < MIN_EXPLAINED:
        raise UnsuitableDraw(f"{list(case.sizes)}: explained {explained:.2f}")
    for k in range(len(own) if len(own) > 1 else 0):
        if fits.visible(fits.left(own[:k] + own[k + 1 :])) < 1.0:
            raise UnsuitableDraw(f"{list(case.sizes)}: one is not visible beside the other")


def ties_of(case: ImpactCase) -> list[list[str]]:
    """Sets of effects of the catalogue that cannot be distinguished from the truth on this log: a
    rival in place of one of the true effects, beside which nothing visible remains.
    """
    if case.kind not in ("single", "pair"):
        return []
    fits = Fits(case)
    ids = list(case.sizes)
    own = [fits.column(i, size) for i, size in case.sizes.items()]
    same = {name for i in ids for name in accepted(BY_ID[i])} | set(ids)
    found = set()
    for effect in CATALOGUE:
        if effect.id in same or not applicable(effect, case.setting):
            continue
        for k in range(len(ids)):
            kept = own[:k] + own[k + 1 :]
            if fits.visible(fits.rival(effect, kept)) < INVISIBLE:
                found.add((*ids[:k], *ids[k + 1 :], effect.id))
    return sorted(list(one) for one in found)
