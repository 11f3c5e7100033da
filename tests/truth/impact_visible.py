"""How far an effect is visible in an impact log: statistics of cycles against their scatter over
what no log reveals.

The statistics of a log are means over stretches of about half a second at constant duty: blow
rate, spread of the blow period, level and ripple of current, speed and supply, and the shapes of
current and speed over the phase of a cycle; and current and speed in the first 60 ms. Their sigma
is the standard deviation over runs of the effect-free tool with other start angles, roughness and
noise, at least the repeatability of a tool that has been put down and taken up again (LEAST_*).
The visibility of an effect, after a fit of the rig's tolerated keys, is the RMS of its mean change
in sigma over the statistics of the group in which that is largest; the visible limit is the size
at which it is 1.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from impact_cases import BENCH, ImpactSetting, Logged, columns, effect_params, simulate
from impact_effects import BY_ID, LARGEST_REDUCTION
from impact_profiles import holds
from responses import fit

SEEDS, TOLERANCE_SEEDS = 10, 5  # runs of a comparison, and of one with a tolerated key changed
CLIP = 10.0  # of a statistic, in sigma
SETTLE_S, STRETCH_S = 0.12, 0.5  # left out after a change of duty; length of a stretch
RUN_UP_S, RUN_UP_PARTS = 0.06, 4
PHASES = 5  # of a cycle
SURE = 2.0  # standard errors of a mean change that do not count
LEAST_GROUP = 16  # statistics
# Least sigma: of a level, of the bus voltage, of the spread of the period, of a ripple (relative,
# but for the spread), of gained angle, retraction, torque; of current in A, of speed in rpm
LEAST_LEVEL, LEAST_BUS, LEAST_SPREAD, LEAST_RIPPLE = 3e-3, 1e-3, 0.02, 0.03
LEAST_BENCH = (5e-3, 0.01, 0.01, 0.02, 0.02)
LEAST_RUN_UP = (0.1, 10.0)
VISIBLE_WITHIN, VISIBLE_ATTEMPTS = 0.08, 9  # of the search for the visible limit


def stretches(setting: ImpactSetting) -> list[tuple[float, float]]:
    """(begin, end) of the stretches of a setting's log in s."""
    out = []
    for begin, end in holds(setting.profile, setting.seconds):
        first = begin + SETTLE_S
        count = max(1, round((end - first) / STRETCH_S))
        edges = np.linspace(first, end, count + 1)
        out += [(float(a), float(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return out


def run_up(setting: ImpactSetting) -> list[tuple[float, float]]:
    """(begin, end) of equal parts of the first run-up in s."""
    begin = float(setting.profile.time_s[np.argmax(setting.profile.duty != 0.0)])
    if setting.profile.smooth:
        begin = float(setting.profile.time_s[1])
    edges = np.linspace(begin, begin + RUN_UP_S, RUN_UP_PARTS + 1)
    return [(float(a), float(b)) for a, b in zip(edges[:-1], edges[1:], strict=True)]


def folded(phase: np.ndarray, values: np.ndarray) -> list[float]:
    """Mean of the values (n,) in each part of the cycle less their mean."""
    part = np.minimum((phase * PHASES).astype(int), PHASES - 1)
    count = np.bincount(part, minlength=PHASES)
    sums = np.bincount(part, values, PHASES)
    return list(np.where(count > 0, sums / np.maximum(count, 1) - values.mean(), 0.0))


def phases_of(time_s: np.ndarray, blow_s: np.ndarray) -> np.ndarray:
    """Phase 0..1 of times (n,) between two blows, nan outside them."""
    n = np.searchsorted(blow_s, time_s, side="right") - 1
    inside = (n >= 0) & (n + 1 < len(blow_s))
    if not inside.any():
        return np.full(len(time_s), np.nan)
    safe = np.clip(n, 0, len(blow_s) - 2)
    return np.where(inside, (time_s - blow_s[safe]) / (blow_s[safe + 1] - blow_s[safe]), np.nan)


def of_stretch(
    table: dict[str, np.ndarray], blow_s: np.ndarray, begin: float, end: float
) -> list[float]:
    """Statistics of one stretch of a log."""
    time = table["time_s"]
    rows = (time > begin) & (time <= end)
    here = blow_s[(blow_s > begin) & (blow_s <= end)]
    period = np.diff(here)
    rate = 1.0 / period.mean() if len(period) > 1 else len(here) / (end - begin)
    spread = float(period.std() / period.mean()) if len(period) > 2 else 0.0
    found = [rate, spread]
    for name in ("current_a", "speed_rpm", "supply_v"):
        found += [float(table[name][rows].mean()), float(table[name][rows].std())]
    phase = phases_of(time[rows] - 5e-4, blow_s)
    cycle = np.isfinite(phase)
    for name in ("current_a", "speed_rpm"):
        values = table[name][rows][cycle]
        found += folded(phase[cycle], values) if cycle.any() else [0.0] * PHASES
    if "hammer_mm" in table:
        found += of_bench(table, rows)
    return found


def of_bench(table: dict[str, np.ndarray], rows: np.ndarray) -> list[float]:
    """Statistics of the bench channels in the rows of a stretch."""
    angle, hammer = table["anvil_angle_rad"][rows], table["hammer_mm"][rows]
    torque = table["anvil_torque_nm"][rows]
    return [
        float(angle[-1] - angle[0]),
        float(hammer.mean()),
        float(np.quantile(hammer, 0.95)),
        float(torque.mean()),
        float(np.quantile(torque, 0.95)),
    ]


def statistics(setting: ImpactSetting, logged: Logged, bench: bool) -> np.ndarray:
    """The statistics (n,) of a run's log."""
    table = columns(setting, logged)
    if not bench:
        table = {name: values for name, values in table.items() if name not in BENCH}
    blow_s = logged.out.blow_s * logged.clock
    found: list[float] = []
    for begin, end in stretches(setting):
        found += of_stretch(table, blow_s, begin, end)
    time = table["time_s"]
    for begin, end in run_up(setting):
        rows = (time > begin) & (time <= end)
        found += [float(table[name][rows].mean()) for name in ("current_a", "speed_rpm")]
    return np.array(found)


@dataclass(frozen=True)
class Reference:
    """Statistics (seeds, n) of the effect-free tool of a setting, their sigma (n,), and their
    responses (n, p) to a sigma of each tolerated key, with the deviations (p,) of the tool in
    sigma.
    """

    setting: ImpactSetting
    seeds: tuple[int, ...]
    values: np.ndarray
    sigma: np.ndarray
    tolerated: np.ndarray
    tool_sigmas: np.ndarray


def all_statistics(
    setting: ImpactSetting, seeds: Sequence[int], params: dict[str, float]
) -> np.ndarray:
    """Statistics (seeds, n) of the tool with the parameters of its effects. The runs are simulated
    at the same time: the library computes without the interpreter.
    """

    def of_seed(seed: int) -> np.ndarray:
        one = replace(setting, seed=seed)
        return statistics(one, simulate(one, params), bool(setting.rig.bench))

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.array(list(pool.map(of_seed, seeds)))


def reference_of(setting: ImpactSetting, count: int = SEEDS) -> Reference:
    """The statistics of the effect-free tool over seeds that are not the case's, without the
    tolerated keys.
    """
    seeds = tuple(setting.seed + 7919 * (n + 1) for n in range(count))
    values = all_statistics(setting, seeds, {})
    least = least_sigma(setting, np.abs(values).mean(axis=0))
    sigma = np.maximum(values.std(axis=0, ddof=1), least)
    return Reference(setting, seeds, values, sigma, np.zeros((len(sigma), 0)), np.zeros(0))


def with_tolerance(reference: Reference) -> Reference:
    """The reference with the responses to the rig's tolerated keys, over TOLERANCE_SEEDS of its
    seeds.
    """
    setting, seeds = reference.setting, reference.seeds[:TOLERANCE_SEEDS]
    columns, tool_sigmas = [], []
    for key, sigma in setting.rig.tolerance.items():
        half, value = 0.5 * sigma * setting.rig[key], setting.tool[key]
        ends = []
        for changed in (value + half, value - half):
            tool = replace(setting.tool, values=setting.tool.values | {key: changed})
            ends.append(all_statistics(replace(setting, tool=tool), seeds, {}).mean(axis=0))
        columns.append((ends[0] - ends[1]) / reference.sigma)
        tool_sigmas.append((value / setting.rig[key] - 1.0) / sigma)
    table = np.array(columns).reshape(len(columns), len(reference.sigma)).T
    return replace(reference, tolerated=table, tool_sigmas=np.array(tool_sigmas))


def least_sigma(setting: ImpactSetting, mean: np.ndarray) -> np.ndarray:
    """Least sigma (n,) of statistics whose mean magnitude is `mean` (n,)."""
    bench = LEAST_BENCH if setting.rig.bench else ()
    length = 8 + 2 * PHASES + len(bench)
    out = []
    for n in range(len(stretches(setting))):
        rate, _, current, ripple_a, speed, ripple_rpm, bus, ripple_v, *rest = mean[n * length :]
        out += [LEAST_LEVEL * rate, LEAST_SPREAD]
        for level, ripple in ((current, ripple_a), (speed, ripple_rpm)):
            out += [LEAST_LEVEL * level, LEAST_RIPPLE * ripple]
        out += [LEAST_BUS * bus, LEAST_RIPPLE * ripple_v + 1e-3]
        out += [LEAST_RIPPLE * ripple_a] * PHASES + [LEAST_RIPPLE * ripple_rpm] * PHASES
        levels = rest[2 * PHASES : 2 * PHASES + len(bench)]
        out += [part * level + 1e-4 for part, level in zip(bench, levels, strict=True)]
    first = len(out)
    for n in range(first, len(mean)):
        out.append(LEAST_LEVEL * mean[n] + LEAST_RUN_UP[(n - first) % 2])
    return np.array(out) + 1e-9


def change(reference: Reference, params: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Mean change (n,) of the statistics that the parameters cause, over the seeds, and its
    standard error (n,), both in sigma.
    """
    found = all_statistics(reference.setting, reference.seeds, params) - reference.values
    error = found.std(axis=0, ddof=1) / len(found) ** 0.5
    return found.mean(axis=0) / reference.sigma, error / reference.sigma


def groups(setting: ImpactSetting) -> np.ndarray:
    """The group of each statistic (n,): blows, current_a, speed_rpm, supply_v, bench, run-up."""
    one = ["blows"] * 2 + ["current_a"] * 2 + ["speed_rpm"] * 2 + ["supply_v"] * 2
    one += ["current_a"] * PHASES + ["speed_rpm"] * PHASES
    one += ["bench"] * (len(LEAST_BENCH) if setting.rig.bench else 0)
    return np.array(one * len(stretches(setting)) + ["run_up"] * 2 * RUN_UP_PARTS)


def sure_squares(found: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Squares (n,) of clipped changes less SURE standard errors."""
    return np.maximum(np.clip(found, -CLIP, CLIP) ** 2 - (SURE * error) ** 2, 0.0)


def strength(group: np.ndarray, found: np.ndarray, error: np.ndarray) -> float:
    """RMS of changes (n,) in sigma over the group in which it is largest, each change clipped, and
    less SURE standard errors (n,). A small group counts as one of LEAST_GROUP.
    """
    squares = sure_squares(found, error)
    names = np.unique(group)
    sums = [
        squares[group == name].sum() / max(np.sum(group == name), LEAST_GROUP) for name in names
    ]
    return float(np.sqrt(max(sums)))


def remainder(
    reference: Reference,
    changed: tuple[np.ndarray, np.ndarray],
    columns: Sequence[np.ndarray] = (),
    least: Sequence[float] = (),
) -> tuple[np.ndarray, np.ndarray]:
    """(coefficients (q,), remainder (n,)) of a fit of the tolerated keys and of q columns (n,) to
    changes (n,) with standard errors (n,); `least` bounds the coefficients.
    """
    found, error = changed
    weight = 1.0 / np.sqrt(1.0 + error**2)
    table = np.array(columns).reshape(len(columns), len(found)).T
    size, left = fit(
        found * weight,
        reference.tolerated * weight[:, None],
        reference.tool_sigmas,
        table * weight[:, None],
        np.array(least, dtype=float) if least else np.full(len(columns), -np.inf),
    )
    return size, left / weight


def visibility(reference: Reference, params: dict[str, float]) -> float:
    """The visibility of effects by their parameters, the tolerated keys fitted."""
    found, error = change(reference, params)
    left = remainder(reference, (found, error))[1]
    return strength(groups(reference.setting), left, error)


def largest(setting: ImpactSetting, effect_id: str, sign: float) -> float:
    """Largest plausible size of an effect, unsigned."""
    top = BY_ID[effect_id].top(setting.tool)
    return min(top, LARGEST_REDUCTION) if sign < 0.0 and top < 2.0 else top


def visible_limit(
    reference: Reference, effect_id: str, sign: float = 1.0, start: float | None = None
) -> float | None:
    """The size (unsigned) at which the visibility is 1, searched from `start`; None where no size
    up to the effect's top is visible.
    """
    effect, top = BY_ID[effect_id], largest(reference.setting, effect_id, sign)
    size = min(start or effect.start_size(reference.setting.tool), top)
    low, high = 0.0, np.inf
    for _ in range(VISIBLE_ATTEMPTS):
        found = visibility(reference, effect_params(reference.setting, effect_id, sign * size))
        if abs(found - 1.0) < VISIBLE_WITHIN:
            return size
        low, high = (size, high) if found < 1.0 else (low, size)
        if found < 1.0 and size >= top:
            return None
        size = min(size * float(np.clip(1.0 / max(found, 1e-6), 0.15, 5.0)), top)
        if not low < size < high:
            size = 0.5 * (low + min(high, top))
    return size if low > 0.0 else None
