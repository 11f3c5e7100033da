"""Draws the disturbances of a case of the regime `measured`: their kinds, sizes and random numbers,
so that each is visible alone, all together are a drawn share of the squared gap, and no effect of
the catalogue explains them.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from cases import Setting
from disturbances import Disturbance, counts_edges
from effects import const
from responses import (
    CLIP,
    HUBER_SIGMA,
    Rival,
    channels,
    fit,
    in_sigma,
    measured,
    modelled,
    noiseless_log,
    rivals,
    sigmas,
    steps_of,
    tolerance_columns,
)
from rigs import Rig


@dataclass(frozen=True)
class DisturbanceLimits:
    """Limits of the draw of disturbances: the definitions of docs/gap_bench.md."""

    counts: tuple[int, ...] = (3, 4, 5)  # disturbances of a case
    visible: tuple[float, float] = (1.5, 10.0)  # RMS gap of each alone, in sigma
    share: tuple[float, float] = (0.1, 0.5)  # of all together in the squared gap of the case
    explained: float = 0.15  # largest share of a disturbance that one effect may explain
    within: float = 0.06  # relative error of the gap in the search for a size
    steps: int = 5  # of that search
    slips_share: float = 0.5  # of the logs of encoders that have slips as well
    slips_per_s: tuple[float, float] = (0.3, 3.0)  # log-uniform
    realisations: int = 4  # sets of random numbers that are tried for a kind


LIMITS = DisturbanceLimits()


class UnsuitableDisturbance(Exception):
    """No disturbances of these shares and sizes fit the log."""


@dataclass(frozen=True)
class Kind:
    """A kind of disturbance: where the search for its size starts and ends (unit: disturbances.py),
    and the logs that can show it.
    """

    start: Callable[[Rig], float]
    top: Callable[[Rig], float]
    usable: Callable[[Setting], bool]


def _coulomb(part: float) -> Callable[[Rig], float]:
    return lambda rig: part * rig.coulomb_nm


def _noise(part: float) -> Callable[[Rig], float]:
    return lambda rig: part * rig.sensors.current_noise_a


def _current(setting: Setting) -> bool:
    return "current_a" in channels(setting.rig)


def _duty(setting: Setting) -> bool:
    return setting.rig.input == "duty"


def can_slip(setting: Setting) -> bool:
    """Encoders: edges counted between rows, or an angle without any other speed sensor."""
    s = setting.rig.sensors
    only_angle = s.position_lsb_rad and not s.hall_pulses_per_rev and not s.speed_noise_rpm
    return counts_edges(s) or bool(only_angle)


KINDS: dict[str, Kind] = {
    "command_jitter": Kind(const(2e-4), const(3e-3), lambda s: s.rig.input != "current_a"),
    "row_batches": Kind(
        const(0.1), const(0.95), lambda s: s.logger in ("ideal", "missing", "lost")
    ),
    "displaced_edges": Kind(
        const(1e-3),
        lambda r: 2.0 / max(r.sensors.hall_pulses_per_rev, 1),
        lambda s: 0 < s.rig.sensors.hall_pulses_per_rev and not counts_edges(s.rig.sensors),
    ),
    "gear_tooth": Kind(_coulomb(0.05), _coulomb(1.0), lambda s: True),
    "supply_sag": Kind(
        const(0.02),
        lambda r: 0.06 * r.voltage_v,
        lambda s: _duty(s) and s.rig.bus != "measured",
    ),
    "friction_drift": Kind(_coulomb(0.05), _coulomb(0.35), lambda s: True),
    "bearing_roughness": Kind(_coulomb(0.1), _coulomb(1.5), lambda s: True),
    "supply_current": Kind(const(0.02), const(0.5), lambda s: _duty(s) and _current(s)),
    "heavy_noise": Kind(_noise(2.0), _noise(25.0), _current),
    "noise_bursts": Kind(_noise(10.0), _noise(150.0), _current),
    "speed_noise": Kind(
        lambda r: 2.0 * r.sensors.speed_noise_rpm,
        lambda r: 25.0 * r.sensors.speed_noise_rpm,
        lambda s: s.rig.sensors.speed_noise_rpm > 0.0,
    ),
    "converter": Kind(_noise(2.0), _noise(25.0), _current),
    "commutation": Kind(const(0.02), const(0.4), _current),
}
# Kinds that change edges or time stamps, so that their samples are not those of the undisturbed log
TIMED = ("row_batches", "slips", "displaced_edges")


class Basis:
    """A noiseless log with the responses to its tolerated keys and to the catalogue's effects."""

    def __init__(self, setting: Setting, params: dict[str, float]) -> None:
        self.setting, self.log = setting, noiseless_log(setting, params)
        self.misses_edges = bool(params.get("hall_dropout"))
        self.base = modelled(self.log, {})
        self.found = measured(self.log) - self.base
        self.tolerated, self.tool_sigmas = tolerance_columns(self.log, self.base)

    @cached_property
    def rivals(self) -> list[Rival]:
        return rivals(self.log, self.base)

    @cached_property
    def itself(self) -> np.ndarray:
        """The samples (n,) of the tool's own run."""
        return in_sigma(self.log, self.log.run, {}, {}, 1.0)

    def clip(self, found: np.ndarray) -> np.ndarray:
        """The clip (n,) of each sample in sigma: 10 max(1, m), m the 95 % quantile of the absolute
        gap of its channel over 1.96 sigma, so that a gap far above the noise counts in full. The
        visible limits of effects have the clip CLIP in every regime. Missed edges are outliers of
        thousands of sigma: a log that has them has the clip HUBER_SIGMA.
        """
        if self.misses_edges:
            return np.full(len(found), HUBER_SIGMA)
        lengths = [channel_length(self, name) for name in sigmas(self.log)]
        ends = np.cumsum(lengths)
        out = np.full(len(found), CLIP)
        for begin, end in zip(ends - lengths, ends, strict=True):
            if end > begin:
                large = float(np.quantile(np.abs(found[begin:end]), 0.95)) / 1.96
                out[begin:end] = CLIP * max(1.0, large)
        return out

    def gap(self, found: np.ndarray, columns: np.ndarray, least: np.ndarray) -> float:
        """RMS of the clipped residual after a fit of the tolerated keys and of `columns` (n, q)."""
        left = fit(found, self.tolerated, self.tool_sigmas, columns, least)[1]
        clip = self.clip(found)
        return float(np.sqrt(np.mean(np.clip(left, -clip, clip) ** 2)))

    def retuned(self, found: np.ndarray) -> float:
        """RMS of the clipped residual after a fit of the tolerated keys."""
        return self.gap(found, np.zeros((len(found), 0)), np.zeros(0))

    def explained(self, found: np.ndarray) -> tuple[float, str]:
        """(largest share of the squared gap that one effect explains, its id)."""
        whole = self.retuned(found)
        shares = [
            (1.0 - (self.gap(found, r.columns, r.least) / whole) ** 2, r.id) for r in self.rivals
        ]
        return max(shares, default=(0.0, ""))

    def with_disturbance(self, d: Disturbance) -> tuple["Basis", np.ndarray]:
        """(basis, deviation (n,) in sigma) of one disturbance: on the samples of this log, or on
        those of a disturbed log where edges or time stamps differ.
        """
        setting = replace(self.setting, disturbances=(d,))
        if d.id in TIMED:
            own = noiseless_log(setting, {})
            if len(measured(own)) == len(self.found):
                return self, measured(own) - modelled(own, {})
            basis = Basis(setting, {})
            return basis, basis.found
        own = noiseless_log(setting, {})
        found = in_sigma(self.log, own.run, {}, {}, 1.0) - self.itself
        if self.setting.rig.input == "current_a" or self.setting.rig.bus == "measured":
            found -= modelled(replace(self.log, command=own.command), {}) - self.base
        return self, found


def channel_length(basis: Basis, name: str) -> int:
    """Number of samples of a channel."""
    rows = basis.log.run.time_s
    lengths = {"speed_rpm": len(basis.log.at_s), "position_rad": len(steps_of(basis.log, rows))}
    return lengths.get(name, len(rows))


@dataclass(frozen=True)
class Drawn:
    """Disturbances of a case, the RMS gap of each alone, and their share of the squared gap."""

    disturbances: tuple[Disturbance, ...]
    multiples: tuple[float, ...]
    share: float


def draw_disturbances(
    setting: Setting, params: dict[str, float], rng: np.random.Generator
) -> Drawn:
    """Three to five disturbances beside the effects of `params`; raises UnsuitableDisturbance."""
    reference = Basis(setting, {})
    goals, share = draw_goals(Basis(setting, params) if params else None, rng)
    kinds = [name for name, kind in KINDS.items() if kind.usable(setting)]
    kinds = [str(name) for name in rng.permutation(kinds)]
    found: list[tuple[Disturbance, float]] = []
    for name in kinds:
        if len(found) < len(goals):
            one = draw_one(reference, name, goals[len(found)], rng)
            found += [one] if one else []
    if len(found) < len(goals):
        raise UnsuitableDisturbance(f"{len(found)} disturbances of {len(goals)} fit")
    found += draw_slips(reference, rng)
    return settled(setting, params, Drawn(*zip(*found, strict=True), share))


def draw_slips(reference: Basis, rng: np.random.Generator) -> list[tuple[Disturbance, float]]:
    """Slips of an encoder, beside the other disturbances and not counted among them: each is an
    outlier far above the clip, so that their gap is below 1.
    """
    rate = float(np.exp(rng.uniform(*np.log(LIMITS.slips_per_s))))
    made = Disturbance("slips", rate, int(rng.integers(1, 2**31)))
    if rng.uniform() >= LIMITS.slips_share or not can_slip(reference.setting):
        return []
    basis, found = reference.with_disturbance(made)
    return [(made, basis.retuned(found))]


def draw_goals(named: Basis | None, rng: np.random.Generator) -> tuple[list[float], float]:
    """(RMS gap of each disturbance alone, share of all in the squared gap); without named effects
    the gaps are log-uniform and the share is 1.
    """
    low, high = LIMITS.visible[0] * (1.0 + LIMITS.within), LIMITS.visible[1] * (1.0 - LIMITS.within)
    count = int(rng.choice(LIMITS.counts))
    if named is None:
        return list(np.exp(rng.uniform(np.log(low), np.log(high), count))), 1.0
    square = named.retuned(named.found) ** 2
    count = min(count, int(square / low**2))  # so that the share can be at most a half
    if count < min(LIMITS.counts):
        raise UnsuitableDisturbance("the effects are smaller than three disturbances")
    least, most = (n / (n + square) for n in (count * low**2, count * high**2))
    if most < LIMITS.share[0]:
        raise UnsuitableDisturbance("the effects are too large for the share")
    share = float(rng.uniform(max(LIMITS.share[0], least), min(LIMITS.share[1], most)))
    spare = square * share / (1.0 - share) - count * low**2
    squares = low**2 + spare * rng.dirichlet(np.full(count, 2.0))
    return [min(float(np.sqrt(one)), high) for one in squares], share


def draw_one(
    reference: Basis, name: str, goal: float, rng: np.random.Generator
) -> tuple[Disturbance, float] | None:
    """(disturbance of a kind, its gap alone); None where no size reaches the goal, or where an
    effect of the catalogue explains too much of every realisation.
    """
    for _ in range(LIMITS.realisations):
        seed = int(rng.integers(1, 2**31))
        one = sized(reference, Disturbance(name, 1.0, seed), goal)
        if one is None:
            return None
        basis, found = reference.with_disturbance(one[0])
        if basis.explained(found)[0] <= LIMITS.explained:
            return one
    return None


def sized(reference: Basis, unit: Disturbance, goal: float) -> tuple[Disturbance, float] | None:
    """(the disturbance `unit` times a size at which its gap alone is `goal`, that gap)."""
    kind, rig = KINDS[unit.id], reference.setting.rig
    size, top = min(kind.start(rig), kind.top(rig)), kind.top(rig)
    for _ in range(LIMITS.steps):
        tried = replace(unit, size=unit.size * size)
        basis, found = reference.with_disturbance(tried)
        gap = basis.retuned(found)
        if abs(gap / goal - 1.0) < LIMITS.within:
            return tried, gap
        if gap < goal and size >= top:
            return None
        size = min(size * float(np.clip(goal / max(gap, 1e-6), 0.05, 20.0)), top)
    return None


def settled(setting: Setting, params: dict[str, float], drawn: Drawn) -> Drawn:
    """The disturbances with sizes at which their share is right beside the effects; raises
    UnsuitableDisturbance where none are, or where an effect of the catalogue explains their sum.
    """
    for _ in range(2):
        alone, share = shares(setting, params, drawn)
        if not params or LIMITS.share[0] <= share <= LIMITS.share[1]:
            explained, name = alone.explained(alone.found)
            if explained > LIMITS.explained:
                raise UnsuitableDisturbance(f"{name} explains {explained:.2f} of the disturbances")
            return replace(drawn, share=share)
        odds = drawn.share / (1.0 - drawn.share) * (1.0 - share) / max(share, 1e-6)
        drawn = rescaled(drawn, max(odds, 1e-6) ** 0.5)
    raise UnsuitableDisturbance(f"the disturbances are {share:.2f} of the squared gap")


def rescaled(drawn: Drawn, factor: float) -> Drawn:
    """All disturbances larger by a factor; UnsuitableDisturbance where one leaves its limits."""
    factors = [factor if d.id in KINDS else 1.0 for d in drawn.disturbances]  # slips stay
    gaps = tuple(gap * f for gap, f in zip(drawn.multiples, factors, strict=True))
    low, high = LIMITS.visible
    if any(f != 1.0 and not low <= gap <= high for gap, f in zip(gaps, factors, strict=True)):
        raise UnsuitableDisturbance("the share needs other sizes")
    made = tuple(
        replace(d, size=d.size * f) for d, f in zip(drawn.disturbances, factors, strict=True)
    )
    return replace(drawn, disturbances=made, multiples=gaps)


def shares(setting: Setting, params: dict[str, float], drawn: Drawn) -> tuple[Basis, float]:
    """(the log with the disturbances alone, their share of the squared gap beside the effects)."""
    disturbed = replace(setting, disturbances=drawn.disturbances)
    alone = Basis(disturbed, {})
    if not params:
        return alone, 1.0
    whole = Basis(disturbed, params)
    return alone, (alone.retuned(alone.found) / whole.retuned(whole.found)) ** 2
