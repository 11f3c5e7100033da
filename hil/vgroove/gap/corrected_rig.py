"""The corrected rig of a verdict: the input rig with retuned values and the selected effects."""

from typing import Any

import numpy as np

from vgroove.gap.catalogue import BY_ID
from vgroove.gap.fitting.hypothesis import Fit
from vgroove.gap.residual.problem import Problem
from vgroove.gap.result import Verdict
from vgroove.gap.verdict.json_values import as_json
from vgroove.rig import Rig
from vgroove.rig_keys import SECTIONS


def corrected_rig(verdict: Verdict) -> Rig:
    """The rig with the retuned values, rounded as in the verdict's JSON, the effects of the
    reported fit, and the clip of each column's residuals (a rig has none for statistics of impact
    cycles).

    A parameter that is a key of another effect in a rig (stiffness and damping of the flanks of a
    play are keys of coupler_compliance) adds the table of that effect.
    """
    problem, fit = verdict.evidence.problem, verdict.evidence.estimate.fit
    owners = dict.fromkeys(
        [*fit.ids, *(p.key_of for i in fit.ids for p in BY_ID[i].parameters if p.key_of)]
    )
    effects = {i: effect_table(problem, fit, i) for i in owners}
    values = as_json(verdict.retuned_parameters)
    clip = {n: one.clip for n, one in verdict.gap.by_signal.items() if n in SECTIONS["clip"]}
    return problem.rig.with_values(values).with_effects(effects).with_clip(as_json(clip))


def corrected_parameters(verdict: Verdict) -> np.ndarray:
    """Parameter vector (P,) of the corrected model."""
    return verdict.evidence.estimate.fit.theta(verdict.evidence.problem.theta0)


def effect_table(problem: Problem, one: Fit, effect_id: str) -> dict[str, Any]:
    """Table [effects.<id>] of a rig: all parameters of the fit, phases and forms included."""
    theta, effect = one.theta(problem.theta0), BY_ID[effect_id]
    table: dict[str, Any] = {
        p.name: float(theta[problem.index(effect.name(p))]) for p in effect.own_parameters
    }
    if effect.counted:
        table[effect.leading.name] = problem.missed_share
    if effect.form and (form := int(theta[problem.index(effect.flag_name)])):
        table[effect.form.key] = effect.form.words[form]
    return table
