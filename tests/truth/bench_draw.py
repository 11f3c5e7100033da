"""Draws a case of the blind set: tool, rig, profile, logger, effects of a visible size, and the
effects that cannot be distinguished from them on the log.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from bench_measured import UnsuitableDisturbance, draw_disturbances
from bench_plan import SEED, SETS, SIZES, Entry, partners
from cases import NOISELESS, Setting, effect_params, simulate
from disturbances import Disturbance
from effects import BY_ID, accepted
from forms import Level, other_form
from profiles import BENCH_NAMES, draw
from responses import (
    FAST,
    Rival,
    applicable,
    clipped_rms,
    compare_fits,
    fit,
    measured,
    modelled,
    noiseless_log,
    rivals,
    times,
    tolerance_columns,
)
from rigs import TOLERANCE, Rig, draw_rig, draw_tool
from signals import Sensors

ATTEMPTS = 120
MAX_ROWS = 24000
# Share of the squared gap that the catalogue's form of an effect must explain, so that an effect in
# another form remains that effect
MIN_EXPLAINED = 0.75
# Share of the squared gap of a case outside the catalogue that any single effect may explain
MAX_EXPLAINED_OUTSIDE = 0.6
RATES = (300.0, 500.0, 1000.0, 1000.0, 1000.0, 2000.0, 4000.0)  # Hz, drawn
SECONDS = (3.0, 20.0)  # log-uniform
# The regime `measured`: at most MAX_ROWS / 2, so that its runs take little time
MEASURED_RATES = RATES[:-1]
MEASURED_SECONDS = (5.0, 10.0)
LOGGERS = (
    ("ideal",) * 10
    + ("irregular",) * 3
    + ("missing",) * 3
    + ("jitter",) * 2
    + ("mixed",)
    + ("lost",)
)
NEAR = 0.5  # of the gap: a rival that leaves less is simulated again at its fitted size
VISIBLE_ATTEMPTS = 9  # of the search for the visible limit
# Effect -> more general effects that contain it as a special case and are no rivals
GENERAL = {"coulomb_friction": ("asymmetric_friction",)}
# Need of an effect -> profiles that fulfil it
NEEDED = {"two_way": ("reversals",), "load": ("load_steps", "reversals"), "slow": ("crawl",)}


@dataclass(frozen=True)
class Case:
    """A drawn case and its answer."""

    entry: Entry
    setting: Setting
    ids: tuple[str, ...]
    sizes: dict[str, float]
    multiples: dict[str, float]
    params: dict[str, float]
    attempt: int = 0
    disturbed_by: tuple[float, ...] = ()  # RMS gap of each disturbance of the setting alone
    share: float = 0.0  # of the disturbances in the squared gap


class UnsuitableDraw(Exception):
    """This draw makes no case; the next one is tried."""


def draw_case(entry: Entry) -> Case:
    """The case of an entry, a function of the entry alone."""
    reasons = []
    for attempt in range(ATTEMPTS):
        try:
            return replace(attempt_case(entry, random_of_attempt(entry, attempt)), attempt=attempt)
        except (UnsuitableDraw, UnsuitableDisturbance, ArithmeticError) as reason:
            reasons.append(str(reason))
    raise RuntimeError(f"{entry}: no case in {ATTEMPTS} draws: {reasons[-3:]}")


def random_of_attempt(entry: Entry, attempt: int) -> np.random.Generator:
    """Random numbers of an attempt."""
    return np.random.default_rng([SEED, SETS.index(entry.set), entry.number, attempt])


def case_again(
    entry: Entry,
    attempt: int,
    sizes: dict[str, float],
    multiples: dict[str, float],
    disturbances: Sequence[Disturbance] = (),
) -> Case:
    """A case with known sizes and disturbances, without the search for them."""
    rng = random_of_attempt(entry, attempt)
    ids = partners(entry, rng)
    setting = draw_setting(entry, ids, rng)
    level, params = level_of(setting), {}
    for effect_id in ids:
        params |= formed(setting, level, effect_id, sizes[effect_id], entry.regime)
    setting = replace(setting, disturbances=tuple(disturbances))
    return Case(entry, setting, tuple(ids), sizes, multiples, params, attempt)


def attempt_case(entry: Entry, rng: np.random.Generator) -> Case:
    """One attempt to draw a case; raises UnsuitableDraw."""
    ids = partners(entry, rng)
    setting = draw_setting(entry, ids, rng)
    if not all(usable(i, setting) for i in ids):
        raise UnsuitableDraw("the log cannot show it")
    level = level_of(setting)
    sizes, multiples, params = {}, {}, {}
    for effect_id in ids:
        sizes[effect_id], multiples[effect_id] = draw_size(
            setting, level, effect_id, entry.regime, rng
        )
        params |= formed(setting, level, effect_id, sizes[effect_id], entry.regime)
    assess(setting, entry.kind, ids, sizes, params)
    case = Case(entry, setting, tuple(ids), sizes, multiples, params)
    if entry.regime != "measured":
        return case
    drawn = draw_disturbances(setting, params, rng)
    disturbed = replace(setting, disturbances=drawn.disturbances)
    return replace(case, setting=disturbed, disturbed_by=drawn.multiples, share=drawn.share)


def usable(effect_id: str, setting: Setting) -> bool:
    """Whether the log can show an effect, of the catalogue or not."""
    rig = setting.rig
    if effect_id in ("u_battery_contact", "u_duty_glitches", "u_brush_contact"):
        return rig.input == "duty" and rig.bus != "measured"
    if effect_id == "u_mains_hum":
        return rig.input != "current_a"
    return effect_id.startswith("u_") or applicable(effect_id, setting)


def draw_setting(entry: Entry, ids: list[str], rng: np.random.Generator) -> Setting:
    """Tool, rig, profile and logger of a case."""
    needs = [BY_ID[i].needs for i in ids if BY_ID[i].needs]
    names = [n for n in BENCH_NAMES if all(n in NEEDED[need] for need in needs)]
    if not names:
        raise UnsuitableDraw("no profile for all of them")
    name = str(rng.choice(names))
    kind = str(rng.choice(["duty", "voltage_v", "current_a"], p=[0.8, 0.13, 0.07]))
    practical = entry.regime == "measured"
    rate = float(rng.choice(MEASURED_RATES if practical else RATES))
    ends = np.log(MEASURED_SECONDS if practical else SECONDS)
    rows = MAX_ROWS / 2 if practical else MAX_ROWS
    seconds = round(min(float(np.exp(rng.uniform(*ends))), rows / rate), 2)
    rig = draw_input(name, kind, draw_sensors(rate, kind, rng), rng)
    rig = replace(rig, tolerance=TOLERANCE) if entry.regime != "exact" else rig
    rig = replace(rig, supply_resistance_ohm=0.0) if kind != "duty" else rig
    load_nm = (
        float(rng.uniform(3.0, 9.0))
        * rig.torque_constant_nm_per_a
        * rig.ratio
        * (rig.voltage_v / 18.0) ** 0.5
    )
    profile = draw(name, seconds, load_nm, rng)
    profile = replace(profile, coast_at_zero=profile.coast_at_zero and kind == "duty")
    rig = replace(rig, load="torque" if len(profile.load_time_s) else "none")
    logger = str(rng.choice(LOGGERS)) if kind == "duty" else "ideal"
    # rows that were lost cannot drive a model
    logger = "ideal" if logger == "lost" and rig.bus == "measured" else logger
    return Setting(rig, draw_tool(rig, rng), profile, seconds, int(rng.integers(1, 2**31)), logger)


def draw_input(profile: str, kind: str, sensors: Sensors, rng: np.random.Generator) -> Rig:
    """A tool with an input of this kind, its slew rate and its bus."""
    fast = profile in ("hand", "stop_and_go", "chirp", "coast_down")
    slew = None if rng.uniform() < 0.25 else (10.0 if fast else 6.0)
    bus = "absent"
    if kind == "duty":
        bus = str(rng.choice(["modelled", "measured", "absent"], p=[0.65, 0.15, 0.2]))
    return draw_rig(rng, sensors=sensors, slew_per_s=slew, input=kind, bus=bus)


def draw_sensors(rate: float, kind: str, rng: np.random.Generator) -> Sensors:
    """Hall sensor, encoder, tachometer or angle; 8 % of the others have an angle as well.

    A current that drives the model has little noise, since the model integrates that noise into a
    speed error that no sensor's sigma includes.
    """
    fine = (
        {"current_noise_a": 0.001, "current_lsb_a": 0.0005}
        if kind == "current_a"
        else {
            "current_noise_a": float(rng.choice([0.05, 0.1, 0.15, 0.3])),
            "current_lsb_a": float(rng.choice([0.05, 0.1, 0.125])),
        }
    )
    what = str(rng.choice(["hall", "encoder", "tacho", "angle"], p=[0.6, 0.2, 0.12, 0.08]))
    edges = {
        "hall": int(rng.choice([2, 4, 4, 4, 6, 8])),
        "encoder": int(rng.choice([16, 32, 64])),
        "tacho": 0,
        "angle": 0,
    }[what]
    lsb = (
        2.0 * np.pi / float(rng.choice([1024, 4096]))
        if what == "angle" or rng.uniform() < 0.08
        else 0.0
    )
    return Sensors(
        log_hz=rate,
        hall_pulses_per_rev=edges,
        hall_timeout_s=float(rng.choice([0.05, 0.1, 0.3])),
        position_lsb_rad=round(lsb, 9),
        speed_noise_rpm=float(rng.choice([3.0, 10.0])) if what == "tacho" else 0.0,
        **fine,
    )


def level_of(setting: Setting) -> Level:
    """RMS of current and speed of the effect-free run."""
    run = simulate(setting, FAST | NOISELESS)[0]
    return Level(
        max(float(np.sqrt(np.mean(run.current_a**2))), 0.1),
        max(float(np.sqrt(np.mean(run.speed_rad_s**2))), 1.0),
    )


def formed(
    setting: Setting, level: Level, effect_id: str, size: float, regime: str
) -> dict[str, float]:
    """Parameters of an effect; in another form than the catalogue's in the regime `hard`, and in
    half of the cases of `measured`.
    """
    made = effect_params(setting, effect_id, size)
    if regime != "hard" and not (regime == "measured" and setting.seed % 2):
        return made
    return other_form(
        effect_id,
        setting.tool,
        made,
        level,
        np.random.default_rng([setting.seed, 31, *effect_id.encode()]),
    )


def gap_left(setting: Setting, params: dict[str, float]) -> float:
    """The gap without noise after a fit of the tolerated keys (nuisance parameters)."""
    log = noiseless_log(setting, params)
    base = modelled(log, {})
    found = measured(log) - base
    return clipped_rms(
        fit(found, *tolerance_columns(log, base), np.zeros((len(found), 0)), np.zeros(0))[1]
    )


def draw_size(
    setting: Setting, level: Level, effect_id: str, regime: str, rng: np.random.Generator
) -> tuple[float, float]:
    """(size with its sign, multiple of the visible limit), log-uniform over the regime's
    multiples.
    """
    effect = BY_ID[effect_id]
    sign = float(rng.choice([-1.0, 1.0])) if effect.signed else 1.0
    least, most = SIZES[regime]
    multiple = float(np.exp(rng.uniform(np.log(least), np.log(most))))
    top = effect.top(setting.tool)
    limit = visible_limit(setting, level, effect_id, sign, regime)
    if limit * least > top:
        raise UnsuitableDraw(f"{effect_id} is hardly visible")
    multiple = min(multiple, top / limit)
    return sign * limit * multiple, multiple


def visible_limit(
    setting: Setting, level: Level, effect_id: str, sign: float, regime: str
) -> float:
    """The size at which the gap without noise is 1 after retuning, within 15 %; the search starts
    from the size at which it is 1 before retuning.
    """
    effect = BY_ID[effect_id]
    top = effect.top(setting.tool)
    untuned = replace(setting, rig=replace(setting.rig, tolerance={}))

    def left(size: float, fitted: Setting) -> float:
        return gap_left(fitted, formed(setting, level, effect_id, sign * size, regime))

    near = search_size(
        lambda size: left(size, untuned),
        min(effect.start_size(setting.tool), top),
        top,
        0.4,
        effect_id,
    )
    return (
        search_size(lambda size: left(size, setting), near, top, 0.15, effect_id)
        if setting.rig.tolerance
        else near
    )


def search_size(
    left: Callable[[float], float], size: float, top: float, within: float, effect_id: str
) -> float:
    """The size at which `left` is 1."""
    low, high = 0.0, np.inf
    for _ in range(VISIBLE_ATTEMPTS):
        gap = left(size)
        if abs(gap - 1.0) < within:
            return min(size / gap, top)  # close to 1 the response is nearly linear
        low, high = (size, high) if gap < 1.0 else (low, size)
        if gap < 1.0 and size >= top:
            raise UnsuitableDraw(f"{effect_id} is invisible")
        size = min(size * float(np.clip(1.0 / max(gap, 1e-6), 0.1, 10.0)), top)
        if not low < size < high:
            size = 0.5 * (low + min(high, top))
    return size


class LinearFits:
    """Linear fits of effects to the noiseless log of a case."""

    def __init__(self, setting: Setting, params: dict[str, float]) -> None:
        self.setting, self.log = setting, noiseless_log(setting, params)
        self.base = modelled(self.log, {})
        self.found = measured(self.log) - self.base
        self.tolerated, self.tool_sigmas = tolerance_columns(self.log, self.base)

    def left_by(
        self, columns: Sequence[np.ndarray], least: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """(coefficients of the columns (n,) each, residual (n,)); `least` bounds the
        coefficients.
        """
        table = np.array(columns).T.reshape(len(self.found), len(columns))
        return fit(
            self.found, self.tolerated, self.tool_sigmas, table, np.array(least, dtype=float)
        )

    def truth(self, ids: Sequence[str], sizes: dict[str, float]) -> list[np.ndarray]:
        """Responses (n,) to the true effects in the catalogue's form."""
        return [
            modelled(self.log, effect_params(self.setting, i, sizes[i])) - self.base for i in ids
        ]

    def rms(self, columns: Sequence[np.ndarray]) -> float:
        """Clipped RMS of the residual of a fit of these columns."""
        return clipped_rms(self.left_by(columns, [-np.inf] * len(columns))[1])


def assess(
    setting: Setting, kind: str, ids: list[str], sizes: dict[str, float], params: dict[str, float]
) -> None:
    """Raise UnsuitableDraw where the catalogue's form of the truth does not explain the log, where
    a single effect of the catalogue explains a case outside it, or where one of several effects is
    not visible beside the others.
    """
    if not ids or "hall_dropout" in ids:  # missed edges are random: no linear response
        return
    linear = LinearFits(setting, params)
    retuned = linear.rms([])
    if kind == "unlisted":
        for rival in rivals(linear.log, linear.base):
            residual = linear.left_by(list(rival.columns.T), list(rival.least))[1]
            explained = 1.0 - (clipped_rms(residual) / retuned) ** 2
            if explained > MAX_EXPLAINED_OUTSIDE:
                raise UnsuitableDraw(f"{ids[0]}: {rival.id} explains {explained:.2f}")
        return
    own = linear.truth(ids, sizes)
    left = linear.rms(own)
    explained = 1.0 - (left / retuned) ** 2
    if explained < MIN_EXPLAINED:
        raise UnsuitableDraw(f"{ids}: the catalogue's form explains {explained:.2f}")
    for k in range(len(own) if len(own) > 1 else 0):
        if linear.rms(own[:k] + own[k + 1 :]) ** 2 - left**2 < 1.0:
            raise UnsuitableDraw(f"{ids}: {ids[k]} is not visible beside the others")


def ties_of(case: Case) -> list[list[str]]:
    """Sets of effects of the catalogue that cannot be distinguished from the truth on this log.

    In each set a rival replaces one or several of the true effects, and the residual is as small,
    or the difference is within the uncertainty by blocks and noise.
    """
    if case.entry.kind in ("none", "unlisted", "disturbances") or "hall_dropout" in case.ids:
        return []
    linear = LinearFits(case.setting, case.params)
    own = linear.truth(case.ids, case.sizes)
    truth, time_s = linear.left_by(own, [-np.inf] * len(own))[1], times(linear.log)
    same = {name for i in case.ids for name in (i, *GENERAL.get(i, ()), *accepts(i, case.setting))}
    found = set()
    for rival in (r for r in rivals(linear.log, linear.base) if r.id not in same):
        for keep in kept_sets(len(own)):
            if compare_rival(rival, linear, [own[k] for k in keep], truth, time_s) >= 0:
                found.add((*(case.ids[k] for k in keep), rival.id))
    return sorted(list(one) for one in found)


def compare_rival(
    rival: Rival, linear: LinearFits, kept: list[np.ndarray], truth: np.ndarray, time_s: np.ndarray
) -> int:
    """compare_fits of a rival beside `kept` true effects.

    A rival that leaves little is simulated again at its fitted size, since its response is not
    exactly linear.
    """
    free = [-np.inf] * len(kept)
    size, left = linear.left_by([*kept, *rival.columns.T], [*free, *rival.least])
    part = float(size[-1])
    if (
        rival.columns.shape[1] != 1
        or abs(part) < 1e-3
        or clipped_rms(left) > NEAR * clipped_rms(linear.found)
    ):
        return compare_fits(time_s, truth, left)
    for _ in range(2):
        try:
            column = modelled(linear.log, rival.again(part)) - linear.base
        except ArithmeticError:
            return -1
        size, left = linear.left_by([*kept, column], [*free, -np.inf])
        part *= float(size[-1])
    return compare_fits(time_s, truth, left)


def kept_sets(count: int) -> list[tuple[int, ...]]:
    """Indices of the true effects that remain where a rival replaces the others, all choices."""
    return [keep for length in range(count) for keep in combinations(range(count), length)]


def accepts(effect_id: str, setting: Setting) -> list[str]:
    """Ids that are equivalent on this log."""
    ids = accepted(BY_ID[effect_id], setting.profile.two_way)
    classes = (
        (("torque_constant", "current_gain"), ("asymmetric_friction", "current_offset"))
        if setting.rig.input == "current_a"
        else ()
    )
    return sorted({*ids, *(i for group in classes if effect_id in group for i in group)})
