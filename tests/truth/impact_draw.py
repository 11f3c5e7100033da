"""Draws a case of the blind set of the impact tool: tool, rig, profile, effects of visible size."""

from pathlib import Path

import numpy as np
from bench_plan import SETS
from impact_assess import assess
from impact_cases import ImpactCase, UnsuitableDraw, effect_params, log_columns
from impact_effects import BY_ID, accepted
from impact_plan import IMPACT_SEED, IMPACT_SIZES, ImpactEntry, impact_partners
from impact_profiles import NAMES
from impact_rigs import impact_toml
from make_impact_cases import ImpactOptions, attempt_case, draw_setting, write_log

DRAWS = 60  # attempts at a case
SECONDS = (1.5, 3.0)


def random_of_attempt(entry: ImpactEntry, attempt: int) -> np.random.Generator:
    """Random numbers of an attempt."""
    return np.random.default_rng([IMPACT_SEED, SETS.index(entry.set), entry.number, attempt])


def options_of(entry: ImpactEntry) -> ImpactOptions:
    """The options of make_impact_cases.py for an entry."""
    loose = float(entry.regime == "loose")
    return ImpactOptions(
        (entry.kind,),
        (),
        IMPACT_SIZES,
        SECONDS,
        (entry.joint,),
        NAMES,
        loose,
        loose,
        float(entry.bench),
    )


def draw_case(entry: ImpactEntry) -> tuple[ImpactCase, int]:
    """(case, attempt) of an entry, a function of the entry alone."""
    reasons = []
    for attempt in range(DRAWS):
        rng = random_of_attempt(entry, attempt)
        ids = impact_partners(entry, rng)
        try:
            setting = draw_setting(ids, options_of(entry), rng)
            case = attempt_case(entry.kind, setting, ids, IMPACT_SIZES, rng)
            assess(case)
            return case, attempt
        except (UnsuitableDraw, ArithmeticError) as reason:
            reasons.append(str(reason))
    raise RuntimeError(f"{entry}: no case in {DRAWS} draws: {reasons[-3:]}")


def case_again(
    entry: ImpactEntry, attempt: int, sizes: dict[str, float], multiples: dict[str, float]
) -> ImpactCase:
    """A case with known sizes, without the search for them."""
    rng = random_of_attempt(entry, attempt)
    ids = impact_partners(entry, rng)
    setting = draw_setting(ids, options_of(entry), rng)
    params: dict[str, float] = {}
    for effect_id in ids:
        params |= effect_params(setting, effect_id, sizes[effect_id])
    return ImpactCase(entry.kind, setting, sizes, multiples, params)


def write_case(case: ImpactCase, folder: Path) -> None:
    """Write log.csv and rig.toml of a case."""
    folder.mkdir(parents=True, exist_ok=True)
    write_log(folder / "log.csv", log_columns(case.setting, case.params))
    (folder / "rig.toml").write_text(impact_toml(case.setting.rig), encoding="utf-8")


def answer_of(entry: ImpactEntry, case: ImpactCase, attempt: int) -> dict[str, object]:
    """The sealed answer of a case, with the keys of those of the drivetrain."""
    setting, rig = case.setting, case.setting.rig
    label = "effect" if case.kind in ("single", "pair") else case.kind
    return {
        "label": label,
        "kind": case.kind,
        "regime": entry.regime,
        "number": entry.number,
        "attempt": attempt,
        "ids": list(case.sizes),
        "accept": [accepted(BY_ID[i]) for i in case.sizes] if label == "effect" else [],
        "sizes": case.sizes,
        "times_visible": case.multiples,
        "truth": case.params,
        "tool": {key: setting.tool[key] for key in rig.tolerance},
        "input": "duty",
        "bus": "modelled",
        "sensor": "hall",
        "position": False,
        "profile": setting.profile.name,
        "two_way": bool(setting.profile.duty.min() < 0.0 < setting.profile.duty.max()),
        "load": True,
        "logger": "ideal",
        "seconds": setting.seconds,
        "log_hz": rig.sensors.log_hz,
        "rig": rig.name,
        "joint": "locked" if rig.locked else rig.joint,
        "bench": bool(rig.bench),
        "other_forms": setting.other_forms,
    }
