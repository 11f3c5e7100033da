"""What an entry of the catalogue states: an effect with its parameters, a load with its keys.

An entry is the one place that names an effect. From it follow the plant's parameters and switches,
the keys of a rig, the fits of the diagnosis, the scores of the blind set and the tables of the
pages. Standard library only: the plant's build reads the catalogue.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from math import inf, log1p

from .keys import ANY, RELATIVE, Key, choice

UNBOUNDED = 1e6  # bound, in units of a parameter's typical size, of a number without a limit
OFF_AT_INFINITY = inf  # neutral value of a limit or a stiffness


@dataclass(frozen=True)
class Scales:
    """Magnitudes of logs and rig, SI, from which the typical sizes of effects are computed.

    volt (V), amp (A), speed (rad/s) and torque (N m) are 99th percentiles of the logged columns;
    inertia (kg m2) is that at the motor shaft, motor_inertia the rotor's alone; resistance (ohm),
    coulomb (N m), viscous (N m s/rad) and the gear ratio are those of the rig; duration (s) is that
    of the longest log, interval (s) the median interval between rows. least_delay (s): a shorter
    delay of the command may come from the logger's choice of the instant that a row stands for.
    clock: standard deviation of the relative error of the logger's clock. hammering: whether the
    tool has an impact mechanism; of such a tool, else 0: head_rad, the angle (rad) by which the
    joint's head turns in the longest log, and joint_nm, the largest torque (N m) of the joint, both
    of the rig's simulation. turns: of the motor between the outermost angles of a log;
    repeated_turns: the same, larger where the motor turns back over them (repeated_range()).
    periods: the largest number of periods a motor turn that the rows resolve.
    edges: whether the speed column is made from Hall edges. shown_amp: the 99th percentile of the
    current (A), three standard deviations of its noise less (not above 0: not known). least: the
    share that is left of a value of the rig at the lower end of its tolerance, by rig key.
    """

    volt: float
    amp: float
    speed: float
    torque: float
    inertia: float
    motor_inertia: float
    resistance: float
    coulomb: float
    viscous: float
    ratio: float
    duration: float
    interval: float
    pwm_hz: float
    supply_ohm: float
    least_delay: float = 0.0
    clock: float = 0.02
    hammering: bool = False
    head_rad: float = 0.0
    joint_nm: float = 0.0
    turns: float = inf
    repeated_turns: float = inf
    periods: float = inf
    edges: bool = False
    shown_amp: float = 0.0
    least: Mapping[str, float] = field(default_factory=dict)

    def least_share(self, key: str) -> float:
        """Share that is left of a value of the rig at the lower end of its tolerance: an effect
        that is subtracted from the value must leave some of it there too.
        """
        return self.least.get(key, 1.0)


OfScales = Callable[[Scales], float]


def constant(value: float) -> OfScales:
    """A size or bound that does not depend on the logs."""
    return lambda s: value


ZERO = constant(0.0)
NO_LOWER_BOUND = constant(-UNBOUNDED)
NO_UPPER_BOUND = constant(UNBOUNDED)


@dataclass(frozen=True)
class Parameter:
    """One number of an effect. Functions of Scales give values in `unit`. A fit works in units of
    `size`, so that its numbers are near 1 for any machine.

    A bound that is not `physical` belongs to the search and is widened where a fit ends at it, as
    far as widest_low and widest_high: a fit that ends there has found no size.
    """

    name: str  # key of a rig and of a verdict
    unit: str
    size: OfScales  # typical visible value: a few per cent of the torque, voltage or current
    low: OfScales = NO_LOWER_BOUND  # bounds of the search
    high: OfScales = NO_UPPER_BOUND
    starts: tuple[float, ...] = (0.0,)  # start values of the fit, in units of size
    step: float = 0.1  # of the finite differences, in units of size
    # in units of size: a smaller number is taken as 0 (a lag of nanoseconds only makes the
    # simulation stiff)
    zero_below: float = 0.0
    reported: bool = True  # whether a verdict lists the number
    key_of: str | None = None  # effect under which a rig states the number, if it is another one
    key: Key = ANY  # values that a rig accepts
    neutral: float = 0.0  # value at which the effect is absent, in `unit`
    # whether a number at its lower bound is no effect: it describes the logger (Scales.least_delay)
    # or what does not repeat (MIN_PERIODS)
    low_is_convention: bool = False
    # bounds that are limits of physics or of docs/spec/gap.md: "low", "high", "both" or "" (0 is
    # one always)
    physical: str = ""
    widest_low: OfScales = constant(-inf)  # limits to which the bounds are widened
    widest_high: OfScales = constant(inf)
    # scale of the sizes that occur in practice, an estimate of the order of magnitude, and scale of
    # a prior with heavy tails (None: no prior). Of a number that is infinite while the effect is
    # absent (a stiffness, a limit) it is a value that is seldom fallen short of; of a factor
    # 1 + relative the logarithm counts.
    plausible: OfScales | None = None
    # whether the number is a place along the run (an end of a wood knot), on which only few rows
    # depend: a fold that lacks these rows cannot fit it, and takes the step of the fit to all rows
    local: bool = False

    def implausibility(self, value: float, scales: Scales, stated: float) -> float:
        """Change from the value that the rig states, or from that with the effect off, in units of
        the plausible scale: values far above 1 are implausible; 0 without such a scale. Of a limit
        or a stiffness the change of the reciprocal counts, of a factor that of its logarithm: half
        of a value is as plausible as twice of it.
        """
        if self.plausible is None:
            return 0.0
        plausible = self.plausible(scales)
        if self.key == RELATIVE:
            return abs(log1p(value) - log1p(stated)) / log1p(plausible)
        if self.neutral == OFF_AT_INFINITY:
            return plausible * abs(_inverse(value) - _inverse(stated))
        return abs(value - stated) / plausible


@dataclass(frozen=True)
class Form:
    """Forms of one law. key: the rig key; words: its values, the first one the default; flag: the
    plant's parameter that holds the index of the word. beyond_specification: words that the
    project's agreed catalogue does not define, so that other programs that read a rig may not know
    them. of_rows: last words, of forms that change a speed column of rows but no Hall edges.
    """

    key: str
    words: tuple[str, ...]
    flag: str
    beyond_specification: tuple[str, ...] = ()
    of_rows: tuple[str, ...] = ()

    @property
    def rig_key(self) -> Key:
        """Values that a rig accepts."""
        return choice(*self.words).optional()


@dataclass(frozen=True)
class Periodic:
    """How an effect repeats with the shaft's angle. amplitude: name of its amplitude's parameter.
    periods: periods a motor turn, as a number, as a parameter's name, or OUTPUT_TURN. moves_shaft:
    True if the speed of the shaft itself ripples, False if only the sensor's reading does.
    """

    amplitude: str
    periods: float | str
    moves_shaft: bool = True

    @property
    def is_fitted(self) -> bool:
        """Whether the number of periods is fitted."""
        return isinstance(self.periods, str) and self.periods != OUTPUT_TURN

    def periods_per_rev(self, value: Callable[[str], float], ratio: float) -> float:
        """Periods a motor turn; value: of a parameter of the effect, ratio: of the gear."""
        if self.periods == OUTPUT_TURN:
            return 1.0 / ratio
        return value(self.periods) if isinstance(self.periods, str) else self.periods


OUTPUT_TURN = "once an output turn"
MIN_PERIODS = 2.0  # of which a log shows that something repeats


@dataclass(frozen=True)
class Separation:
    """The run of the menu (gap/next_run) that separates an effect from another one, and why."""

    other: str
    run: str
    reason: str


def _inverse(limit: float) -> float:
    """The reciprocal of a limit or a stiffness; 0 where it is off, which the plant's parameters
    hold as 0.
    """
    return 1.0 / limit if limit > 0.0 else 0.0


@dataclass(frozen=True)
class Effect:
    """One physical effect that the nominal model leaves out.

    equation, remark: texts of docs/spec/gap.md, section 3.
    parameters: the first one is the leading one, whose value is the effect's size.
    needs: what a log must hold to show the effect, as flags of NEEDS.
    special_case_of: more general effects that contain it as a limit.
    identical_to: effects that predict the same logs, each with the flags of NEEDS under which that
    holds; this effect is the likelier one.
    switch: the plant computes the effect if one of these parameters is not neutral; empty where the
    effect only changes a constant of the model, or where the plant's component decides.
    equations: equations of the model that it enters, where they are not its subsystem's.
    loads: kinds of load that it acts on; empty: all.
    friction_law: a torque that depends on speed alone; sums of such laws imitate other ones.
    less_likely: of two effects that predict a log equally well the other one is taken.
    constant_beside: in a set with this other effect only the difference of the two parameters is
    fitted, a constant torque, because the other effect describes their mean.
    counted: the value is counted from the logs, not fitted.
    separations: runs that separate it from other effects for a known physical reason.
    hammering: its parameters in a tool with impact mechanism, where their sizes differ.
    is_resolved: whether the rows of the logs resolve it at values of its parameters, by name; a fit
    does not start at other ones. None: at any.
    """

    id: str
    subsystem: str
    equation: str
    parameters: tuple[Parameter, ...]
    needs: tuple[str, ...] = ()
    form: Form | None = None
    periodic: Periodic | None = None
    special_case_of: tuple[str, ...] = ()
    identical_to: tuple[tuple[str, tuple[str, ...]], ...] = ()
    switch: tuple[str, ...] = ()
    equations: tuple[str, ...] = ()
    loads: tuple[str, ...] = ()
    remark: str = ""
    friction_law: bool = False
    less_likely: bool = False
    constant_beside: str = ""
    counted: bool = False
    separations: tuple[Separation, ...] = ()
    hammering: tuple[Parameter, ...] = ()
    is_resolved: Callable[[Mapping[str, float], Scales], bool] | None = None

    def of_tool(self, scales: Scales) -> "Effect":
        """The effect with the sizes, bounds, starts and forms of the tool and the logs that the
        scales describe.
        """
        found = self
        if scales.hammering and self.hammering:
            found = replace(found, parameters=self.hammering, is_resolved=None)
        if found.form and found.form.of_rows and (scales.hammering or scales.edges):
            words = tuple(w for w in found.form.words if w not in found.form.of_rows)
            found = replace(found, form=replace(found.form, words=words))
        return found

    @property
    def has_phase(self) -> bool:
        """Whether it has an amplitude and a phase (fitted as sine and cosine amplitude)."""
        return self.periodic is not None

    @property
    def forms(self) -> tuple[tuple[tuple[str, float], ...], ...]:
        """The forms to try, the default first, each as (plant parameter, value) of its flags."""
        others = range(1, len(self.form.words)) if self.form else ()
        return ((), *(((self.flag_name, float(word)),) for word in others))

    @property
    def flag_name(self) -> str:
        """Plant parameter that holds the index of the form; empty for an effect of one form."""
        return f"effects.{self.id}.{self.form.flag}" if self.form else ""

    @property
    def leading(self) -> Parameter:
        """The parameter whose value is the effect's size."""
        return self.parameters[0]

    @property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """Parameters that are the effect's own keys in a rig."""
        return tuple(p for p in self.parameters if p.key_of is None)

    @property
    def rig_keys(self) -> dict[str, Key]:
        """Keys of [effects.<id>] in a rig."""
        keys = {p.name: p.key for p in self.own_parameters}
        return keys | ({self.form.key: self.form.rig_key} if self.form else {})

    @property
    def flat(self) -> dict[str, float]:
        """The plant's parameters of this effect by name, with their neutral values."""
        values = {p.name: p.neutral for p in self.own_parameters}
        return values | ({self.form.flag: 0.0} if self.form else {})

    @property
    def count(self) -> int:
        """Fitted numbers, the phase included."""
        return len(self.parameters)

    def name(self, parameter: Parameter) -> str:
        """Name of a fitted number."""
        return f"effects.{self.id}.{parameter.name}"

    def column(self, parameter: Parameter) -> str:
        """Name in the plant's parameter vector."""
        return f"effects.{parameter.key_of or self.id}.{parameter.name}"

    def beside(self, ids: Iterable[str]) -> tuple[Parameter, ...]:
        """Parameters that are fitted for it in a set with the effects `ids`: those that are no keys
        of one of these.
        """
        return tuple(p for p in self.parameters if p.key_of not in ids)


@dataclass(frozen=True)
class LoadKey:
    """One key of [load]. key: the values that a rig accepts; default: the value where a rig leaves
    it out (None: the key is no parameter of the plant's load).
    """

    name: str
    unit: str
    key: Key
    default: float | None = 0.0


@dataclass(frozen=True)
class Load:
    """One kind of load: its keys in a rig, and its law as text (docs/spec/model.md, section 6).

    joint: it twists elastically up to a slip torque. diagnosed: logs of a tool with this load can
    be diagnosed.
    """

    kind: str
    law: str
    keys: tuple[LoadKey, ...] = ()
    joint: bool = False
    diagnosed: bool = False
    form: Form | None = None

    @property
    def rig_keys(self) -> dict[str, Key]:
        """Keys of [load] in a rig of this kind."""
        keys = {k.name: k.key for k in self.keys}
        return keys | ({self.form.key: self.form.rig_key} if self.form else {})

    @property
    def flat(self) -> dict[str, float]:
        """The plant's parameters of this load by name, with their defaults."""
        values = {k.name: k.default for k in self.keys if k.default is not None}
        return values | ({self.form.flag: 0.0} if self.form else {})
