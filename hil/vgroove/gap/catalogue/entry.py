"""What an entry of the catalogue states: an effect with its parameters, a load with its keys.

An entry is the one place that names an effect. From it follow the plant's parameters and switches,
the keys of a rig, the fits of the diagnosis, the scores of the blind set and the tables of the
pages. Standard library only: the plant's build reads the catalogue.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import inf

from .keys import ANY, Key, choice

UNBOUNDED = 1e6  # bound, in units of a parameter's typical size, of a number without a limit
OFF_AT_INFINITY = inf  # neutral value of a limit or a stiffness


@dataclass(frozen=True)
class Scales:
    """What the logs and the rig span, SI: the units in which effects are sized.

    The magnitudes volt, amp (A), speed (rad/s) and torque (N m) are the 99th percentiles of the
    logged columns; inertia (kg m2) is that at the motor shaft, motor_inertia the rotor's alone;
    resistance (ohm), coulomb (N m) and viscous (N m s/rad) are the motor's; duration (s) is the
    longest log's, interval (s) the median row interval; least_delay (s) is the shortest delay that
    is not a convention of the logger.
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


OfScales = Callable[[Scales], float]


def constant(value: float) -> OfScales:
    """A size or bound that no log changes."""
    return lambda s: value


ZERO = constant(0.0)
NO_LOWER_BOUND = constant(-UNBOUNDED)
NO_UPPER_BOUND = constant(UNBOUNDED)


@dataclass(frozen=True)
class Parameter:
    """One number of an effect.

    key: values that a rig accepts. neutral: the value with the effect off. size: the typical value
    at which the effect shows on a log (a few per cent of the torque, voltage or current there), so
    that a fit works in numbers near one on a wrist motor and on a machine axis alike. low, high:
    bounds of the search, SI. In units of size: starts of the fit, step of its differences, and
    least, below which the number is taken as 0 (a lag of nanoseconds would only make the simulation
    stiff). reported: whether a verdict lists the number. of: the effect whose key this number is in
    a rig, where it is another's. low_is_convention: a number at its lower bound describes the
    logger, not an effect.
    """

    name: str
    unit: str
    size: OfScales
    low: OfScales = NO_LOWER_BOUND
    high: OfScales = NO_UPPER_BOUND
    starts: tuple[float, ...] = (0.0,)
    step: float = 0.1
    least: float = 0.0
    reported: bool = True
    of: str | None = None
    key: Key = ANY
    neutral: float = 0.0
    low_is_convention: bool = False


@dataclass(frozen=True)
class Form:
    """Two forms of one law: the rig key and its words, the first the default, and the plant's
    parameter that is 1 for the second word. beyond_specification: docs/spec/gap.md, section 3, has
    the first form alone, so that other readers of a rig know no other.
    """

    key: str
    words: tuple[str, str]
    flag: str
    beyond_specification: bool = False

    @property
    def rig_key(self) -> Key:
        """Values that a rig accepts."""
        return choice(*self.words).optional()


@dataclass(frozen=True)
class Periodic:
    """An effect that repeats with the shaft's angle: its amplitude's parameter; its periods a motor
    turn, a number, a parameter's name, or OUTPUT_TURN; whether the shaft itself turns unevenly or
    only its sensor reads so.
    """

    amplitude: str
    periods: float | str
    moves_shaft: bool = True

    def periods_per_rev(self, value: Callable[[str], float], ratio: float) -> float:
        """Periods a motor turn; value: of a parameter of the effect, ratio: of the gear."""
        if self.periods == OUTPUT_TURN:
            return 1.0 / ratio
        return value(self.periods) if isinstance(self.periods, str) else self.periods


OUTPUT_TURN = "once an output turn"


@dataclass(frozen=True)
class Separation:
    """The run of the menu (gap/next_run) that separates an effect from another one, and why."""

    other: str
    run: str
    reason: str


@dataclass(frozen=True)
class Effect:
    """One physical effect that the nominal model leaves out.

    equation, remark: docs/spec/gap.md, section 3, is written from them. parameters: the first one
    is the leading one, whose value stands for the effect's size. needs: what a log must hold to show it, flags of
    NEEDS. special_case_of: more general effects that contain it as a limit. identical_to: effects
    that no run tells from it, each with the flags under which that holds; this one is the likelier.
    switch: parameters whose departure from neutral makes the plant compute the effect; empty where
    it only changes a constant of the model, or where the component decides. equations: those of the
    model that it enters, where they are not its subsystem's. loads: kinds that it acts on, where
    not all. friction_law: a torque over speed alone, so that sums of some such laws imitate others.
    less_likely: of two effects that predict a log alike the other one is taken. constant_beside: an
    effect beside which only the difference of the two parameters is this effect's own, a constant
    torque. counted: the value is counted from the logs, not fitted. separations: runs that separate
    it from others, where the physics is known.
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

    @property
    def phase(self) -> bool:
        """Whether amplitude and phase are fitted as sine and cosine amplitudes."""
        return self.periodic is not None

    @property
    def forms(self) -> tuple[tuple[tuple[str, float], ...], ...]:
        """Settings (flat parameter name, value) that are tried, not fitted; the default first."""
        return ((), ((self.flag_name, 1.0),)) if self.form else ((),)

    @property
    def flag_name(self) -> str:
        """Flat parameter that is 1 for the second form; empty for an effect of one form."""
        return f"effects.{self.id}.{self.form.flag}" if self.form else ""

    @property
    def leading(self) -> Parameter:
        """The parameter that stands for the effect's size."""
        return self.parameters[0]

    @property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """Parameters that are the effect's own keys in a rig."""
        return tuple(p for p in self.parameters if p.of is None)

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
        """Name in the simulator's flat parameter vector."""
        return f"effects.{parameter.of or self.id}.{parameter.name}"

    def beside(self, ids: Iterable[str]) -> tuple[Parameter, ...]:
        """Parameters that are left to it beside other effects."""
        return tuple(p for p in self.parameters if p.of not in ids)


@dataclass(frozen=True)
class LoadKey:
    """One key of [load]: the values that a rig accepts, and the value where a rig leaves it out
    (None: a word, no parameter of the plant).
    """

    name: str
    unit: str
    key: Key
    default: float | None = 0.0


@dataclass(frozen=True)
class Load:
    """One kind of load: its keys in a rig, and its law as text (docs/spec/model.md, section 6).

    joint: it twists elastically up to a slip torque. diagnosed: logs with it can be diagnosed.
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
