"""Makes folders with a measured-like log of the impact tool, rig and label:
`make_impact_cases.py OUT --seed N --count M [--kind ...]`.
"""

import argparse
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from impact_assess import assess
from impact_cases import (
    BENCH,
    ImpactCase,
    ImpactSetting,
    UnsuitableDraw,
    effect_params,
    log_columns,
    simulate,
)
from impact_effects import BY_ID, CATALOGUE, OUTSIDE_IDS, accepted
from impact_joints import TURN
from impact_profiles import NAMES, draw_impact
from impact_rigs import (
    draw_impact_rig,
    draw_impact_tool,
    draw_tolerance,
    impact_toml,
    tightened,
    without_same,
)
from impact_visible import Reference, largest, reference_of, visible_limit, with_tolerance
from make_cases import FORMATS as DRIVE_FORMATS
from make_cases import write_cases

FORMATS = DRIVE_FORMATS | {
    "anvil_torque_nm": "{:.2f}",
    "anvil_angle_rad": "{:.5f}",
    "hammer_mm": "{:.3f}",
}
JOINT_NAMES = ("locked", "hard_joint", "disc_spring", "wood_screw")
KINDS = ("single", "none", "unlisted", "pair")
# Of 20 mixed cases 13 singles, 3 without effect, 2 unlisted, 2 pairs
MIXED = (
    ("single",) * 4
    + ("none",)
    + ("single",) * 4
    + ("pair", "unlisted", "none")
    + ("single",) * 5
    + ("pair", "unlisted", "none")
)
ATTEMPTS = 30
LEAST_BLOWS = 12  # of the effect-free tool and of the log
LEAST_TURNS = 1.0  # of a screw in its joint
SLEWS = (None, None, 5.0, 10.0)  # per s, drawn


@dataclass(frozen=True)
class ImpactOptions:
    """Options of a set of cases; `tool` and `joint` are the shares of cases with a tool and a joint
    off by the rig's tolerances (half of these have effects of other forms than the catalogue's),
    `bench` the share with bench channels; `sizes` are multiples of the
    visible limit.
    """

    kinds: tuple[str, ...]
    ids: tuple[str, ...]
    sizes: tuple[float, float]
    seconds: tuple[float, float]
    joints: tuple[str, ...]
    profiles: tuple[str, ...]
    tool: float
    joint: float
    bench: float


def effects_of(
    kind: str, index: int, options: ImpactOptions, rng: np.random.Generator
) -> list[str]:
    """Ids of a case: singles by `index` in turns, pairs with a drawn effect that is not equivalent,
    unlisted ones from outside the catalogue.
    """
    if kind == "none":
        return []
    if kind == "unlisted":
        return [OUTSIDE_IDS[index % len(OUTSIDE_IDS)]]
    first = options.ids[index % len(options.ids)]
    if kind == "single":
        return [first]
    others = [i for i in options.ids if not set(accepted(BY_ID[i])) & set(accepted(BY_ID[first]))]
    return [first, str(rng.choice(others))]


def possible_joints(ids: list[str], options: ImpactOptions) -> list[str]:
    """The joints of the options that show all effects."""
    return [name for name in options.joints if all(name in BY_ID[i].joints for i in ids)]


def draw_setting(ids: list[str], options: ImpactOptions, rng: np.random.Generator) -> ImpactSetting:
    """Tool, joint and profile of a case."""
    joints = possible_joints(ids, options)
    if not joints:
        raise UnsuitableDraw(f"no joint for {ids}")
    slew = SLEWS[int(rng.integers(len(SLEWS)))]
    bench = BENCH if rng.uniform() < options.bench else ()
    rig = draw_impact_rig(str(rng.choice(joints)), rng, slew_per_s=slew, bench=bench)
    known = rng.uniform() >= options.tool, rng.uniform() >= options.joint
    tolerance = draw_tolerance(rig, not known[0], not known[1], rng)
    rig = replace(rig, tolerance=without_same(tolerance, ids))
    names = [n for n in options.profiles if n != "loosen" or not rig.locked]
    if any(BY_ID[i].needs == "loosen" for i in ids):
        names = ["loosen"]
    if any(BY_ID[i].needs == "partial" for i in ids):
        names = [n for n in names if n in ("levels", "ramp", "plain")] or ["levels"]
    seconds = round(float(rng.uniform(*options.seconds)), 1)
    tight = rig.joint != "hard_joint"
    name = str(rng.choice(names))
    rig = tightened(rig, rng) if name == "loosen" else rig
    profile = draw_impact(name, seconds, tight, rng)
    seed = int(rng.integers(1, 2**31))
    other = bool(rig.tolerance) and bool(seed % 2)
    return ImpactSetting(rig, draw_impact_tool(rig, rng), profile, seconds, seed, other)


def draw_impact_case(kind: str, index: int, options: ImpactOptions, seed: int) -> ImpactCase:
    """A case; draws again where the tool does not hammer or an effect is not visible, up to
    ATTEMPTS times.
    """
    reasons = []
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([seed, index, attempt])
        ids = effects_of(kind, index, options, rng)
        try:
            case = attempt_case(kind, draw_setting(ids, options, rng), ids, options.sizes, rng)
            assess(case)
            return case
        except (UnsuitableDraw, ArithmeticError) as reason:
            reasons.append(str(reason))
    raise RuntimeError(f"no case of {kind} {index} in {ATTEMPTS} draws: {reasons[-3:]}")


def attempt_case(
    kind: str,
    setting: ImpactSetting,
    ids: list[str],
    multiples: tuple[float, float],
    rng: np.random.Generator,
) -> ImpactCase:
    """The case of a setting; raises UnsuitableDraw."""
    check_run(setting, {})
    sizes, times, params = {}, {}, {}
    for effect_id, drawn in draw_sizes(setting, ids, multiples, rng).items():
        sizes[effect_id], times[effect_id] = drawn
        params |= effect_params(setting, effect_id, sizes[effect_id])
    if ids:
        check_run(setting, params)
    return ImpactCase(kind, setting, sizes, times, params)


def check_run(setting: ImpactSetting, params: dict[str, float]) -> None:
    """Raise UnsuitableDraw where the tool hardly hammers, or turns the screw out of its joint."""
    out = simulate(setting, params).out
    if len(out.blow_s) < LEAST_BLOWS:
        raise UnsuitableDraw("the tool hardly hammers")
    turns = setting.tool.values.get("load.from_turns")
    if turns is not None and turns + out.anvil_angle_rad.min() / TURN < LEAST_TURNS:
        raise UnsuitableDraw("the joint comes loose")


def draw_sizes(
    setting: ImpactSetting, ids: list[str], multiples: tuple[float, float], rng: np.random.Generator
) -> dict[str, tuple[float, float]]:
    """(size with its sign, multiple of the visible limit) of each effect, the multiple log-uniform.

    The limit is searched with the tolerated keys trusted first, which is quicker.
    """
    plain = reference_of(setting) if ids else None
    near, signs = {}, {}
    for effect_id in ids:
        signs[effect_id] = float(rng.choice([-1.0, 1.0])) if BY_ID[effect_id].signed else 1.0
        near[effect_id] = enough(plain, effect_id, signs[effect_id], multiples[0], None)
    tolerant = with_tolerance(plain) if ids and setting.rig.tolerance else plain
    out = {}
    for effect_id in ids:
        sign, limit = signs[effect_id], near[effect_id]
        if tolerant is not plain:
            limit = enough(tolerant, effect_id, sign, multiples[0], limit)
        top = largest(setting, effect_id, sign)
        multiple = min(float(np.exp(rng.uniform(*np.log(multiples)))), top / limit)
        out[effect_id] = (sign * limit * multiple, multiple)
    return out


def enough(
    reference: Reference, effect_id: str, sign: float, least: float, start: float | None
) -> float:
    """The visible limit; raises UnsuitableDraw where `least` times it is above the effect's top."""
    limit = visible_limit(reference, effect_id, sign, start)
    if limit is None or limit * least > largest(reference.setting, effect_id, sign):
        raise UnsuitableDraw(f"{effect_id} is hardly visible")
    return limit


def write_log(path: Path, table: dict[str, np.ndarray]) -> None:
    """The log as CSV."""
    texts = [[FORMATS[name].format(v + 0.0) for v in values] for name, values in table.items()]
    rows = [",".join(row) for row in zip(*texts, strict=True)]
    path.write_text("\n".join([",".join(table), *rows]) + "\n", encoding="utf-8")


def label_of(case: ImpactCase) -> dict[str, object]:
    """The label of a case; `truth` are all changed parameters of the tool."""
    setting, rig = case.setting, case.setting.rig
    label = "effect" if case.kind in ("single", "pair") else case.kind
    found = {
        "label": label,
        "ids": list(case.sizes) if label == "effect" else [],
        "accept": [accepted(BY_ID[i]) for i in case.sizes] if label == "effect" else [],
        "regime": "loose" if rig.tolerance else "exact",
        "sizes": case.sizes,
        "times_visible": {i: round(m, 3) for i, m in case.multiples.items()},
        "truth": case.params,
        "joint": "locked" if rig.locked else rig.joint,
        "profile": setting.profile.name,
        "bench": list(rig.bench),
        "other_forms": setting.other_forms,
        "seed": setting.seed,
    }
    if label == "unlisted":
        found["what"] = next(iter(case.sizes))
    if rig.tolerance:
        found["tool"] = {key: setting.tool[key] for key in rig.tolerance}
    return found


def write_impact_case(
    folder: Path, kind: str, index: int, options: ImpactOptions, seed: int
) -> str:
    """Make one case and return a line about it."""
    case = draw_impact_case(kind, index, options, seed)
    folder.mkdir(parents=True, exist_ok=True)
    write_log(folder / "log.csv", log_columns(case.setting, case.params))
    (folder / "rig.toml").write_text(impact_toml(case.setting.rig), encoding="utf-8")
    label = label_of(case)
    (folder / "label.json").write_text(json.dumps(label, indent=1) + "\n", encoding="utf-8")
    sizes = ", ".join(f"{i} {s:.4g} (x{case.multiples[i]:.2f})" for i, s in case.sizes.items())
    return f"{folder.name} {kind} {label['joint']} {label['profile']} {label['regime']} {sizes}"


def parser_of_options() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--kind", default="mixed", help=f"{', '.join(KINDS)}, mixed, with commas")
    parser.add_argument("--ids", default="all", help="effects with commas, mechanism, drive or all")
    parser.add_argument("--size", default="1.5:10", help="multiples of the visible limit, A:B")
    parser.add_argument("--seconds", default="1.5:3", help="length of the logs, A:B")
    parser.add_argument("--joints", default=",".join(JOINT_NAMES))
    parser.add_argument("--profiles", default=",".join(NAMES))
    parser.add_argument("--tool", type=float, default=0.0, help="share of rigs off by tolerances")
    parser.add_argument("--joint", type=float, default=0.0, help="share of joints not known")
    parser.add_argument("--bench", type=float, default=0.0, help="share with bench channels")
    parser.add_argument("--jobs", type=int, default=1)
    return parser


def pair_of(text: str) -> tuple[float, float]:
    """Two numbers of the form A:B."""
    low, high = text.split(":")
    return float(low), float(high)


def ids_of(text: str) -> tuple[str, ...]:
    """The effects of the option --ids."""
    groups = {
        group: tuple(e.id for e in CATALOGUE if e.group == group)
        for group in ("mechanism", "drive")
    } | {"all": tuple(e.id for e in CATALOGUE)}
    return groups.get(text, tuple(text.split(",")))


def main(arguments: list[str]) -> int:
    args = parser_of_options().parse_args(arguments)
    unknown = [i for i in ids_of(args.ids) if i not in BY_ID]
    if unknown:
        sys.stderr.write(f"{unknown[0]} is no effect of the generator\n")
        return 2
    kinds = MIXED if args.kind == "mixed" else tuple(args.kind.split(","))
    joints = tuple(args.joints.split(","))
    options = ImpactOptions(
        kinds,
        tuple(i for i in ids_of(args.ids) if set(BY_ID[i].joints) & set(joints)),
        pair_of(args.size),
        pair_of(args.seconds),
        joints,
        tuple(args.profiles.split(",")),
        args.tool,
        args.joint,
        args.bench,
    )
    serial = dict.fromkeys(KINDS, 0)
    plan = []
    for n in range(args.count):
        kind = kinds[n % len(kinds)]
        plan.append((args.out / f"case_{n:03d}", kind, serial[kind], options, args.seed))
        serial[kind] += 1
    write_cases(write_impact_case, plan, args.jobs)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
