"""Makes folders with measured-like log, rig and label: `make_cases.py OUT --seed N --count M
[--kind ...]`.
"""

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from cases import Setting, columns, effect_params, visible_limit
from disturbances import IDS, Disturbance
from effects import BY_ID, CATALOGUE, FIRST, OUTSIDE_IDS, accepted
from profiles import NAMES, draw
from rigs import TOLERANCE, draw_rig, draw_tool, toml
from signals import Sensors

FORMATS = {
    "time_s": "{:.6g}",
    "duty": "{:.4f}",
    "coast": "{:.0f}",
    "supply_v": "{:.2f}",
    "current_a": "{:.2f}",
    "speed_rpm": "{:.1f}",
    "load_nm": "{:.4f}",
}
KINDS = ("single", "none", "unlisted", "pair")
# Of 20 mixed cases 15 singles, 2 without effect, 2 unlisted, 1 pair
MIXED = (
    ("single",) * 7
    + ("none",)
    + ("single",) * 5
    + ("unlisted",)
    + ("single",) * 3
    + ("none", "unlisted", "pair")
)
ATTEMPTS = 20


@dataclass(frozen=True)
class CaseOptions:
    """Options of a set of cases; `tolerance` and `steps` are the shares of cases with a rig off by
    its tolerances and with a command without a slew rate; `disturbances` are (id, size).
    """

    kinds: tuple[str, ...]
    ids: tuple[str, ...]
    sizes: tuple[float, float]
    seconds: float
    log_hz: float
    profiles: tuple[str, ...]
    tolerance: float
    logger: str
    steps: float
    disturbances: tuple[tuple[str, float], ...] = ()


def draw_setting(options: CaseOptions, rng: np.random.Generator, need: str) -> Setting:
    """Tool, profile and logger of a case; `need` is Effect.needs."""
    wanted = {"two_way": ("reversals",), "load": ("load_steps",), "slow": ("crawl",)}.get(
        need, options.profiles
    )
    sensors = Sensors(log_hz=options.log_hz)
    rig = draw_rig(rng, sensors=sensors, slew_per_s=None if rng.uniform() < options.steps else 6.0)
    if rng.uniform() < options.tolerance:
        rig = replace(rig, tolerance=TOLERANCE)
    name = str(rng.choice(wanted))
    if name in ("hand", "stop_and_go", "chirp") and rig.slew_per_s:
        rig = replace(rig, slew_per_s=10.0)
    load_nm = (
        float(rng.uniform(3.0, 9.0))
        * rig.torque_constant_nm_per_a
        * rig.ratio
        * (rig.voltage_v / 18.0) ** 0.5
    )
    profile = draw(name, options.seconds, load_nm, rng)
    rig = replace(rig, load="torque" if len(profile.load_time_s) else "none")
    return Setting(
        rig,
        draw_tool(rig, rng),
        profile,
        options.seconds,
        int(rng.integers(1, 2**31)),
        options.logger,
    )


def effects_of(kind: str, index: int, options: CaseOptions, rng: np.random.Generator) -> list[str]:
    """Ids of a case: singles by `index` in turns, pairs with a drawn effect that is not equivalent,
    unlisted ones from outside the catalogue.
    """
    if kind == "none":
        return []
    if kind == "unlisted":
        return [OUTSIDE_IDS[int(rng.integers(len(OUTSIDE_IDS)))]]
    first = options.ids[index % len(options.ids)]
    if kind == "single":
        return [first]
    others = [
        i
        for i in options.ids
        if i != first and not set(accepted(BY_ID[i], True)) & set(accepted(BY_ID[first], True))
    ]
    return [first, str(rng.choice(others))]


def draw_case(
    kind: str, index: int, options: CaseOptions, seed: int
) -> tuple[Setting, dict[str, float], dict[str, float]]:
    """(setting, size of each effect, its multiple of the visible limit); draws again where an
    effect is not visible, up to ATTEMPTS times.
    """
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([seed, index, attempt])
        ids = effects_of(kind, index, options, rng)
        needs = [BY_ID[i].needs for i in ids if BY_ID[i].needs]
        setting = draw_setting(options, rng, needs[0] if needs else "")
        sizes, multiples = {}, {}
        for effect_id in ids:
            drawn = draw_size(setting, effect_id, options, rng)
            if drawn is None:
                break
            sizes[effect_id], multiples[effect_id] = drawn
        if len(sizes) == len(ids):
            return setting, sizes, multiples
    raise RuntimeError(f"no visible case of {ids} in {ATTEMPTS} draws")


def draw_size(
    setting: Setting, effect_id: str, options: CaseOptions, rng: np.random.Generator
) -> tuple[float, float] | None:
    """(size, multiple of the visible limit), the multiple log-uniform over `options.sizes`; None
    where the size exceeds the effect's top.
    """
    effect = BY_ID[effect_id]
    sign = float(rng.choice([-1.0, 1.0])) if effect.signed else 1.0
    multiple = float(np.exp(rng.uniform(*np.log(options.sizes))))
    limit = visible_limit(setting, effect_id, sign)
    if limit is None or limit * options.sizes[0] > effect.top(setting.rig):
        return None
    multiple = min(multiple, effect.top(setting.rig) / limit)
    return sign * limit * multiple, multiple


def cell(name: str, value: float) -> str:
    """A number as the log has it; empty for nan."""
    text = "" if np.isnan(value) else FORMATS[name].format(value)
    return text.replace("-0.00", "0.00") if text == "-0.00" else text


def write_log(path: Path, table: dict[str, np.ndarray]) -> None:
    names = list(table)
    rows = [
        ",".join(cell(name, table[name][n]) for name in names) for n in range(len(table["time_s"]))
    ]
    path.write_text("\n".join([",".join(names), *rows]) + "\n")


def write_case(folder: Path, kind: str, index: int, options: CaseOptions, seed: int) -> str:
    """Make one case and return a line about it."""
    setting, sizes, multiples = draw_case(kind, index, options, seed)
    params: dict[str, float] = {}
    for effect_id, size in sizes.items():
        params |= effect_params(setting, effect_id, size)
    setting = disturbed(setting, options)
    folder.mkdir(parents=True, exist_ok=True)
    table = columns(setting, params)
    del table["angle_rad"]
    write_log(folder / "log.csv", table)
    (folder / "rig.toml").write_text(toml(setting.rig))
    label = label_of(kind, setting, sizes, multiples, params)
    (folder / "label.json").write_text(json.dumps(label, indent=1) + "\n")
    sizes_text = ", ".join(f"{i} {size:.4g} (x{multiples[i]:.2f})" for i, size in sizes.items())
    return f"{folder.name} {kind} {setting.rig.name} {setting.profile.name} {sizes_text}"


def disturbed(setting: Setting, options: CaseOptions) -> Setting:
    """The setting with the disturbances of the options; their random numbers are of its seed."""
    made = (Disturbance(name, size, setting.seed) for name, size in options.disturbances)
    return replace(setting, disturbances=tuple(made))


def label_of(
    kind: str,
    setting: Setting,
    sizes: dict[str, float],
    multiples: dict[str, float],
    params: dict[str, float],
) -> dict[str, object]:
    """The label as in tests/data/practice; `truth` are all changed parameters of the tool."""
    two_way = setting.profile.two_way
    label = {"single": "effect", "pair": "effect"}.get(kind, kind)
    ids = list(sizes) if label == "effect" else []
    found = {
        "label": label,
        "ids": ids,
        "accept": [accepted(BY_ID[i], two_way) for i in ids],
        "sizes": sizes,
        "times_visible": {i: round(m, 3) for i, m in multiples.items()},
        "truth": params,
        "profile": setting.profile.name,
        "seed": setting.seed,
    }
    if setting.disturbances:
        found["disturbances"] = {d.id: d.size for d in setting.disturbances}
    if label == "unlisted":
        found["what"] = next(iter(sizes))
    if setting.rig.tolerance:
        found["tool"] = {
            key: getattr(setting.tool, key.split(".")[1]) for key in setting.rig.tolerance
        }
    return found


def parser_of_options() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument(
        "--kind",
        default="mixed",
        help="single, none, unlisted, pair, mixed, or several with commas",
    )
    parser.add_argument("--ids", default="first", help="first, all, or ids with commas")
    parser.add_argument("--size", default="1.5:8", help="multiples of the visible limit, low:high")
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--log-hz", type=float, default=1000.0)
    parser.add_argument("--profiles", default="all")
    parser.add_argument(
        "--tolerance",
        type=float,
        default=0.25,
        help="share of cases whose tool is off by a stated tolerance",
    )
    parser.add_argument(
        "--steps",
        type=float,
        default=0.2,
        help="share of cases whose command steps from row to row, without a slew rate",
    )
    parser.add_argument(
        "--logger", default="ideal", choices=("ideal", "irregular", "missing", "jitter", "mixed")
    )
    parser.add_argument(
        "--disturbances", default="", help="ID:SIZE with commas, of disturbances.py"
    )
    parser.add_argument("--jobs", type=int, default=2)
    return parser


def parse(arguments: list[str]) -> tuple[argparse.Namespace, CaseOptions]:
    """Arguments and case options of a command line."""
    args = parser_of_options().parse_args(arguments)
    kinds = MIXED if args.kind == "mixed" else tuple(args.kind.split(","))
    ids = {"first": FIRST, "all": tuple(e.id for e in CATALOGUE)}.get(args.ids) or tuple(
        args.ids.split(",")
    )
    low, high = (float(x) for x in args.size.split(":"))
    profiles = NAMES if args.profiles == "all" else tuple(args.profiles.split(","))
    return args, CaseOptions(
        kinds,
        ids,
        (low, high),
        args.seconds,
        args.log_hz,
        profiles,
        args.tolerance,
        args.logger,
        args.steps,
        sized(args.disturbances),
    )


def sized(text: str) -> tuple[tuple[str, float], ...]:
    """(id, size) of each disturbance of the option --disturbances."""
    pairs = (part.split(":") for part in text.split(",") if part)
    return tuple((name, float(size)) for name, size in pairs)


def main(arguments: list[str]) -> int:
    args, options = parse(arguments)
    unknown = [name for name in options.ids if name not in BY_ID]
    unknown += [name for name, _ in options.disturbances if name not in IDS]
    if unknown:
        sys.stderr.write(f"{unknown[0]} is no effect or disturbance of the generator\n")
        return 2
    kinds = [options.kinds[n % len(options.kinds)] for n in range(args.count)]
    serial = {kind: 0 for kind in kinds}
    plan = []
    for n, kind in enumerate(kinds):
        plan.append(
            (
                args.out / f"case_{n + 1:03d}",
                kind,
                serial[kind] if kind == "single" else n,
                options,
                args.seed,
            )
        )
        serial[kind] += 1
    write_cases(write_case, plan, args.jobs)
    return 0


def write_cases(write: Callable[..., str], plan: Sequence[tuple[object, ...]], jobs: int) -> None:
    """Call `write` with the arguments of each case of the plan, `jobs` at a time, and print the
    lines that it returns.
    """
    with ProcessPoolExecutor(jobs) as pool:
        for line in pool.map(write, *zip(*plan, strict=True)):
            sys.stdout.write(line + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
