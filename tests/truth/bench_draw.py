"""Draws a case of the blind set: tool, rig, profile, logger, effects of a visible size, and who
could be mistaken for them in principle.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from bench_plan import SEED, SETS, SIZES, Entry, partners
from cases import SILENT, Setting, effect_params, simulate
from effects import BY_ID, accepted
from forms import Level, other_form
from profiles import BENCH_NAMES, draw
from responses import (
    FAST,
    Rival,
    applicable,
    clipped_rms,
    fit,
    measured,
    modelled,
    rivals,
    seen,
    tied,
    times,
    tolerance_columns,
)
from rigs import TOLERANCE, draw_rig, draw_tool
from signals import Sensors

ATTEMPTS = 60
ROWS_MOST = 24000
CLOSES_LEAST = 0.75  # of the squared gap: an effect in another form must still be that effect
OUTSIDE_MOST = 0.6  # of the squared gap of a case outside the catalogue that any one effect takes
RATES = (300.0, 500.0, 1000.0, 1000.0, 1000.0, 2000.0, 4000.0)
LOGGERS = (
    ("ideal",) * 10
    + ("irregular",) * 3
    + ("missing",) * 3
    + ("jitter",) * 2
    + ("mixed",)
    + ("lost",)
)
NEAR = 0.5
# contain the effect as a special case: no rivals
GENERAL = {"coulomb_friction": ("asymmetric_friction",)}
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


class Unfit(Exception):
    """This draw makes no case; the next is tried."""


def draw_case(entry: Entry) -> Case:
    """The case of an entry; always the same."""
    reasons = []
    for attempt in range(ATTEMPTS):
        try:
            return replace(attempt_case(entry, chance(entry, attempt)), attempt=attempt)
        except (Unfit, ArithmeticError) as reason:
            reasons.append(str(reason))
    raise RuntimeError(f"{entry}: no case in {ATTEMPTS} draws: {reasons[-3:]}")


def chance(entry: Entry, attempt: int) -> np.random.Generator:
    return np.random.default_rng([SEED, SETS.index(entry.set), entry.number, attempt])


def case_again(
    entry: Entry, attempt: int, sizes: dict[str, float], multiples: dict[str, float]
) -> Case:
    """A case that was drawn before, without the search for its sizes."""
    rng = chance(entry, attempt)
    ids = partners(entry, rng)
    setting = draw_setting(entry, ids, rng)
    level, params = level_of(setting), {}
    for effect_id in ids:
        params |= formed(setting, level, effect_id, sizes[effect_id], entry.regime)
    return Case(entry, setting, tuple(ids), sizes, multiples, params, attempt)


def attempt_case(entry: Entry, rng: np.random.Generator) -> Case:
    ids = partners(entry, rng)
    setting = draw_setting(entry, ids, rng)
    if not all(usable(i, setting) for i in ids):
        raise Unfit("the log cannot show it")
    level = level_of(setting)
    sizes, multiples, params = {}, {}, {}
    for effect_id in ids:
        sizes[effect_id], multiples[effect_id] = draw_size(
            setting, level, effect_id, entry.regime, rng
        )
        params |= formed(setting, level, effect_id, sizes[effect_id], entry.regime)
    assess(setting, entry.kind, ids, sizes, params)
    return Case(entry, setting, tuple(ids), sizes, multiples, params)


def usable(effect_id: str, setting: Setting) -> bool:
    """Whether an effect, of the catalogue or not, can show itself in the log."""
    rig = setting.rig
    if effect_id in ("u_battery_contact", "u_duty_glitches", "u_brush_contact"):
        return rig.input == "duty" and rig.bus != "measured"
    if effect_id == "u_mains_hum":
        return rig.input != "current_a"
    return effect_id.startswith("u_") or applicable(effect_id, setting)


def draw_setting(entry: Entry, ids: list[str], rng: np.random.Generator) -> Setting:
    """Tool, rig, profile and logger."""
    needs = [BY_ID[i].needs for i in ids if BY_ID[i].needs]
    names = [n for n in BENCH_NAMES if all(n in NEEDED[need] for need in needs)]
    if not names:
        raise Unfit("no profile for all of them")
    name = str(rng.choice(names))
    kind = str(rng.choice(["duty", "voltage_v", "current_a"], p=[0.8, 0.13, 0.07]))
    rate = float(rng.choice(RATES))
    seconds = round(min(float(np.exp(rng.uniform(np.log(3.0), np.log(20.0)))), ROWS_MOST / rate), 2)
    sensors = draw_sensors(rate, kind, rng)
    slew = (
        None
        if rng.uniform() < 0.25
        else 10.0
        if name in ("hand", "stop_and_go", "chirp", "coast_down")
        else 6.0
    )
    bus = (
        str(rng.choice(["modelled", "measured", "absent"], p=[0.65, 0.15, 0.2]))
        if kind == "duty"
        else "absent"
    )
    rig = draw_rig(rng, sensors=sensors, slew_per_s=slew, input=kind, bus=bus)
    rig = replace(rig, tolerance=TOLERANCE) if entry.regime == "hard" else rig
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
    # a model cannot be driven by rows that are not there
    logger = "ideal" if logger == "lost" and bus == "measured" else logger
    return Setting(rig, draw_tool(rig, rng), profile, seconds, int(rng.integers(1, 2**31)), logger)


def draw_sensors(rate: float, kind: str, rng: np.random.Generator) -> Sensors:
    """Hall, encoder or tachometer; now and then an angle as well, or alone. A current that drives
    the model is measured finely: its noise would add up to a speed that no sensor's sigma speaks
    of.
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
    run = simulate(setting, FAST | SILENT)[0]
    return Level(
        max(float(np.sqrt(np.mean(run.current_a**2))), 0.1),
        max(float(np.sqrt(np.mean(run.speed_rad_s**2))), 1.0),
    )


def formed(
    setting: Setting, level: Level, effect_id: str, size: float, regime: str
) -> dict[str, float]:
    """Parameters of an effect, in another form than the catalogue's where the regime says so."""
    made = effect_params(setting, effect_id, size)
    if regime != "hard":
        return made
    return other_form(
        effect_id,
        setting.tool,
        made,
        level,
        np.random.default_rng([setting.seed, 31, *effect_id.encode()]),
    )


def gap_left(setting: Setting, params: dict[str, float]) -> float:
    """The gap without noise after retuning the tolerated keys."""
    log = seen(setting, params)
    base = modelled(log, {})
    found = measured(log) - base
    return clipped_rms(
        fit(found, *tolerance_columns(log, base), np.zeros((len(found), 0)), np.zeros(0))[1]
    )


def draw_size(
    setting: Setting, level: Level, effect_id: str, regime: str, rng: np.random.Generator
) -> tuple[float, float]:
    """(signed size, multiple of the visible limit), log-uniform in the regime's multiples."""
    effect = BY_ID[effect_id]
    sign = float(rng.choice([-1.0, 1.0])) if effect.signed else 1.0
    least, most = SIZES[regime]
    multiple = float(np.exp(rng.uniform(np.log(least), np.log(most))))
    top = effect.top(setting.tool)
    limit = visible_limit(setting, level, effect_id, sign, regime)
    if limit * least > top:
        raise Unfit(f"{effect_id} is hardly visible")
    multiple = min(multiple, top / limit)
    return sign * limit * multiple, multiple


def visible_limit(
    setting: Setting, level: Level, effect_id: str, sign: float, regime: str
) -> float:
    """The size at which the gap without noise is 1 after retuning, within 15 %; it is sought first
    where it shows before retuning.
    """
    effect = BY_ID[effect_id]
    top = effect.top(setting.tool)
    untuned = replace(setting, rig=replace(setting.rig, tolerance={}))

    def left(size: float, judged: Setting) -> float:
        return gap_left(judged, formed(setting, level, effect_id, sign * size, regime))

    near = search_size(
        lambda size: left(size, untuned), min(effect.guess(setting.tool), top), top, 0.4, effect_id
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
    for _ in range(9):
        seen_gap = left(size)
        if abs(seen_gap - 1.0) < within:
            return min(size / seen_gap, top)  # the response is nearly linear so close to 1
        low, high = (size, high) if seen_gap < 1.0 else (low, size)
        if seen_gap < 1.0 and size >= top:
            raise Unfit(f"{effect_id} is invisible")
        size = min(size * float(np.clip(1.0 / max(seen_gap, 1e-6), 0.1, 10.0)), top)
        if not low < size < high:
            size = 0.5 * (low + min(high, top))
    return size


class Linear:
    """A case's log as linear fits see it."""

    def __init__(self, setting: Setting, params: dict[str, float]) -> None:
        self.setting, self.log = setting, seen(setting, params)
        self.base = modelled(self.log, {})
        self.found = measured(self.log) - self.base
        self.tolerated, self.stands = tolerance_columns(self.log, self.base)

    def left_by(
        self, columns: Sequence[np.ndarray], least: Sequence[float]
    ) -> tuple[np.ndarray, np.ndarray]:
        """(coefficients, what is left)."""
        table = np.array(columns).T.reshape(len(self.found), len(columns))
        return fit(self.found, self.tolerated, self.stands, table, np.array(least, dtype=float))

    def truth(self, ids: Sequence[str], sizes: dict[str, float]) -> list[np.ndarray]:
        """Responses to the true effects in the catalogue's form."""
        return [
            modelled(self.log, effect_params(self.setting, i, sizes[i])) - self.base for i in ids
        ]

    def rms(self, columns: Sequence[np.ndarray]) -> float:
        return clipped_rms(self.left_by(columns, [-np.inf] * len(columns))[1])


def assess(
    setting: Setting, kind: str, ids: list[str], sizes: dict[str, float], params: dict[str, float]
) -> None:
    """Raises Unfit when the catalogue's form of the truth would not be the answer, or one of
    several effects hides behind the others.
    """
    if kind == "none" or "hall_dropout" in ids:
        return
    linear = Linear(setting, params)
    retuned = linear.rms([])
    if kind == "unlisted":
        for rival in rivals(linear.log, linear.base):
            closes = (
                1.0
                - (
                    clipped_rms(linear.left_by(list(rival.columns.T), list(rival.least))[1])
                    / retuned
                )
                ** 2
            )
            if closes > OUTSIDE_MOST:
                raise Unfit(f"{ids[0]}: {rival.id} takes {closes:.2f}")
        return
    own = linear.truth(ids, sizes)
    left = linear.rms(own)
    if 1.0 - (left / retuned) ** 2 < CLOSES_LEAST:
        raise Unfit(f"{ids}: the catalogue's form closes {1.0 - (left / retuned) ** 2:.2f}")
    for k in range(len(own) if len(own) > 1 else 0):
        if linear.rms(own[:k] + own[k + 1 :]) ** 2 - left**2 < 1.0:
            raise Unfit(f"{ids}: {ids[k]} hides behind the others")


def ties_of(case: Case) -> list[list[str]]:
    """Sets of effects of the catalogue that nobody could tell from the truth on this log: replaced
    by a rival, one or several of the true effects leave as little, or the difference lies within
    what blocks and noise leave open.
    """
    if case.entry.kind in ("none", "unlisted") or "hall_dropout" in case.ids:
        return []
    linear = Linear(case.setting, case.params)
    own = linear.truth(case.ids, case.sizes)
    truth, time_s = linear.left_by(own, [-np.inf] * len(own))[1], times(linear.log)
    same = {name for i in case.ids for name in (i, *GENERAL.get(i, ()), *accepts(i, case.setting))}
    found = set()
    for rival in (r for r in rivals(linear.log, linear.base) if r.id not in same):
        for keep in kept_sets(len(own)):
            if verdict_on(rival, linear, [own[k] for k in keep], truth, time_s) >= 0:
                found.add((*(case.ids[k] for k in keep), rival.id))
    return sorted(list(one) for one in found)


def verdict_on(
    rival: Rival, linear: Linear, kept: list[np.ndarray], truth: np.ndarray, time_s: np.ndarray
) -> int:
    """As `tied`; a rival that comes near is simulated again at the size that the fit gave it, since
    its response is not quite linear.
    """
    free = [-np.inf] * len(kept)
    size, left = linear.left_by([*kept, *rival.columns.T], [*free, *rival.least])
    part = float(size[-1])
    if (
        rival.columns.shape[1] != 1
        or abs(part) < 1e-3
        or clipped_rms(left) > NEAR * clipped_rms(linear.found)
    ):
        return tied(time_s, truth, left)
    for _ in range(2):
        try:
            column = modelled(linear.log, rival.again(part)) - linear.base
        except ArithmeticError:
            return -1
        size, left = linear.left_by([*kept, column], [*free, -np.inf])
        part *= float(size[-1])
    return tied(time_s, truth, left)


def kept_sets(count: int) -> list[tuple[int, ...]]:
    """Which of the true effects stay while a rival takes the place of the rest."""
    return [keep for length in range(count) for keep in combinations(range(count), length)]


def accepts(effect_id: str, setting: Setting) -> list[str]:
    """Ids that are the same thing on this log."""
    ids = accepted(BY_ID[effect_id], setting.profile.two_way)
    classes = (
        (("torque_constant", "current_gain"), ("asymmetric_friction", "current_offset"))
        if setting.rig.input == "current_a"
        else ()
    )
    return sorted({*ids, *(i for group in classes if effect_id in group for i in group)})
