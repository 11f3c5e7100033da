"""Independent reference of the impact mechanism: docs/spec/model.md, sections 1, 2, 4, 5 and 6,
integrated by SciPy at rtol 1e-10.

Written from that page alone; shares no code with plant/. Contact, lug, joint and friction are
modes: inside a mode the right-hand side is smooth, and a mode ends where one of its margins passes
zero, located to rounding. It is slow, because every event ends an integration, so the runs that the
tests compare with are stored in impact_reference.json, which the command
`python tests/python/impact_reference.py [CASE...]` writes (Radau, ten minutes).

Where the page leaves a choice: the hammer's start angle is the angle from the anvil's flank to the
flank of the hammer, negative before it; the contact ramp is linear; lug top and end stop have
stiffness, damping and ramp of the flanks; a contact of either flank is recorded, with the number of
its lug; the head angle that counts for the slip torque is at least 0; at a release and at the end
of an overlap the contact force becomes 0 at once.
"""

from __future__ import annotations

import dataclasses
import json
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.integrate import DOP853, LSODA, Radau
from scipy.optimize import brentq

RESULTS = Path(__file__).with_name("impact_reference.json")
SOLVERS = {"DOP853": DOP853, "Radau": Radau, "LSODA": LSODA}
RTOL = 1e-10
MAX_STEP_S = 2e-5
REPEAT_AFTER_S, REPEAT_SPEED = 3e-3, 0.25
I, THJ, WJ, THS, WS, THA, WA, E, CHARGE, BUS, TURN = range(11)  # noqa: E741
ATOL = np.array([1e-9, 1e-12, 1e-9, 1e-12, 1e-9, 1e-13, 1e-9, 1e-13, 1e-10, 1e-10, 1e-10])
# a contact: apart, approaching within the ramp, approaching beyond it, separating
FREE, RAMP, FULL, BACK = range(4)
# the hammer's lugs: in a gap below h, above h beside the lugs, over a lug
GAP, CLEAR, OVER = range(3)
STICK, FORWARD, BACKWARD = range(3)  # the joint
BLOW, REPEAT, REBOUND = range(3)  # kinds of contacts: docs/spec/model.md, section 4
# a mode ends where one of its margins is this far beyond zero
PEN_EPS, RATE_EPS, ANGLE_EPS, TORQUE_EPS, CURRENT_EPS = 1e-13, 1e-10, 1e-12, 1e-9, 1e-10


@dataclass(frozen=True)
class Tool:
    """Reference set of docs/spec/model.md, section 4, in its symbols and in SI units. A hard joint
    has the slip torque run_nm + slope * head angle forwards.
    """

    voc: float = 18.5
    rs: float = 0.10
    r: float = 0.19
    l: float = 1e-4  # noqa: E741
    kt: float = 0.0109
    jm: float = 1.6e-5
    b: float = 4.5e-6
    tc: float = 0.012
    n: float = 5.6
    jj: float = 6e-6
    js: float = 4.5e-5
    m: float = 0.19
    lead: float = 4.4e-3
    vertex: float = 0.05
    q_max: float = 2.8
    f0: float = 220.0
    k: float = 29400.0
    lugs: int = 2
    h: float = 4.5e-3
    r_lug: float = 0.015
    overlap: float = 1.0
    ck: float = 3e7
    cb: float = 2e3
    ramp: float = 1e-5
    ja: float = 1.2e-5
    kj: float = 3000.0
    cj: float = 0.3
    run_nm: float = math.inf
    slope: float = 0.0
    loosen: float = 0.75
    start: float = -1.0
    duty: float = 1.0
    joint: str = "hard"  # hard | wood | discs
    from_turns: float = 0.0
    mirrored: bool = False  # a run in reverse: angles, speeds and torques have the other sign
    slew: float = math.inf  # rate at which the duty rises, 1/s
    stop_s: float = math.inf  # release of the trigger: the bridge brakes (duty 0) or coasts (open)
    coast: bool = False

    def slip(self, head: float) -> tuple[float, float]:
        """Slip torques forwards and backwards at a head angle, N m."""
        turns = self.from_turns + (-head if self.mirrored else head) / (2 * math.pi)
        if self.joint == "wood":
            tight = wood_nm(turns)
            both = (tight, WOOD_LOOSEN * tight)
        elif self.joint == "discs":
            force = discs_n(turns)
            both = (self.run_nm + force * bolt_m(1.0), self.run_nm + force * bolt_m(-1.0))
        else:
            gained = self.slope * max(head, 0.0)
            both = (self.run_nm + gained, self.run_nm + self.loosen * gained)
        return both[::-1] if self.mirrored else both


# Section 6: lag screw M6 (the rig's keys), disc springs 40 x 20.4 x 1.5 with n = 4, i = 42,
# bolt M16.
WOOD_START, WOOD_END, WOOD_TURNS, WOOD_SEAT, WOOD_SEAT_DEG, WOOD_STRIPPED, WOOD_LOOSEN = (
    0.5,
    6.0,
    36.0,
    12.0,
    90.0,
    0.35,
    0.6,
)
DISC_OUTER, DISC_INNER, DISC_T, DISC_H0, DISC_PARALLEL, DISC_SERIES = (
    0.040,
    0.0204,
    1.5e-3,
    1.15e-3,
    4,
    42,
)
BOLT_PITCH, BOLT_FLANK, BOLT_HEAD, BOLT_MU = 2e-3, 14.701e-3, 20e-3, 0.12


def wood_nm(turns: float) -> float:
    """Torque that turns the screw further in, at its depth."""
    if turns <= WOOD_TURNS:
        return WOOD_START + (WOOD_END - WOOD_START) * max(turns, 0.0) / WOOD_TURNS
    beyond_deg = 360.0 * (turns - WOOD_TURNS)
    if beyond_deg <= WOOD_SEAT_DEG:
        return WOOD_END + (WOOD_SEAT - WOOD_END) * beyond_deg / WOOD_SEAT_DEG
    return max(
        WOOD_SEAT * (1.0 - 0.5 * (beyond_deg - WOOD_SEAT_DEG) / 90.0), WOOD_STRIPPED * WOOD_SEAT
    )


def discs_n(turns: float) -> float:
    """Force of the stack (DIN EN 16984) after so many turns of the bolt."""
    d = DISC_OUTER / DISC_INNER
    k1 = ((d - 1) / d) ** 2 / ((d + 1) / (d - 1) - 2 / math.log(d)) / math.pi
    s, h = BOLT_PITCH * max(turns, 0.0) / DISC_SERIES / DISC_T, DISC_H0 / DISC_T
    single = (
        4
        * 206e9
        / (1 - 0.3**2)
        * DISC_T**4
        / (k1 * DISC_OUTER**2)
        * s
        * ((h - s) * (h - s / 2) + 1)
    )
    return DISC_PARALLEL * single


def bolt_m(way: float) -> float:
    """Torque over bolt force in m, tightening (way 1) or loosening (way -1)."""
    return way * 0.16 * BOLT_PITCH + 0.58 * BOLT_FLANK * BOLT_MU + BOLT_HEAD / 2 * BOLT_MU


@dataclass(frozen=True)
class Case:
    """A run of the reference tool at full trigger with some numbers changed."""

    seconds: float
    changes: dict[str, float | str | bool]

    def tool(self) -> Tool:
        return dataclasses.replace(Tool(), **self.changes)


SLOPE_700 = {"run_nm": 0.3, "slope": 700.0}
CASES = {
    "locked": Case(0.5, {}),
    "slip_60": Case(1.0, {"run_nm": 60.0}),
    "slope_700": Case(1.0, SLOPE_700),
    "slip_6": Case(0.5, {"run_nm": 6.0}),
    "locked_duty_0.5": Case(0.5, {"duty": 0.5}),
    "locked_duty_0.3": Case(0.5, {"duty": 0.3}),
    "locked_duty_0.7": Case(0.5, {"duty": 0.7}),
    "slip_60_20.5_v": Case(0.5, {"run_nm": 60.0, "voc": 20.5}),
    "wood": Case(0.5, {"joint": "wood", "from_turns": 12.0, "kj": 100.0}),
    "wood_seating": Case(0.5, {"joint": "wood", "from_turns": 35.0, "kj": 100.0}),
    "wood_loosened": Case(
        0.5,
        {
            "joint": "wood",
            "from_turns": 30.0,
            "kj": 100.0,
            "mirrored": True,
            "start": 2.0 - math.pi,
        },
    ),
    "discs": Case(0.5, {"joint": "discs", "from_turns": 4.0, "run_nm": 0.3}),
    "ramp": Case(0.5, SLOPE_700 | {"slew": 5.0}),
    "braked": Case(0.3, SLOPE_700 | {"stop_s": 0.2}),
    "let_go": Case(0.4, SLOPE_700 | {"stop_s": 0.2, "coast": True}),
    "free": Case(0.5, {"start": -1000.0}),
}
ROW_S = 1e-2
COLUMNS = [
    "time_s",
    "charge_as",
    "bus_vs",
    "current_a",
    "speed_rad_s",
    "angle_rad",
    "anvil_torque_nm",
    "anvil_angle_rad",
    "head_rad",
    # at the instant; charge, bus and housing are integrals from 0
    "hammer_mm",
    "hammer_rad",
    "housing_nms",
]


@dataclass
class Mode:
    lugs: int = GAP
    # gap in which, or lug over which, the hammer's lug is; lug g is behind gap g, lug g + 1 in
    # front of it
    index: int = 0
    forward: int = FREE
    rear: int = FREE
    top: int = FREE
    stop: int = FREE
    joint: int = STICK
    spin: float = 0.0
    stopped: bool = False
    diode: float = 0.0  # sign of the current that the diodes carry while the bridge is open


@dataclass
class Contact:
    """A touch of a flank, lugs counted from 0; peak_nm is the largest joint torque, either way,
    until the next touch.
    """

    time_s: float
    lug: int
    kind: int
    approach_rad_s: float
    peak_nm: float = 0.0


@dataclass
class Result:
    contacts: list[Contact] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)
    hammer_mm: float = 0.0

    def blows(self) -> list[Contact]:
        return [c for c in self.contacts if c.kind == BLOW]


def push(pen: float, rate: float, mode: int, tool: Tool) -> float:
    """Force of the contact law of section 5 with exponent 1 in a given mode, N."""
    if mode == FREE:
        return 0.0
    damping = (
        tool.cb * rate
        if mode == FULL
        else (tool.cb * rate * pen / tool.ramp if mode == RAMP else 0.0)
    )
    return tool.ck * pen + damping


def contact_margins(pen: float, rate: float, mode: int, tool: Tool) -> list[float]:
    """Margins of a contact's mode, scaled so that the mode ends at -1."""
    if mode == FREE:
        return [-pen / PEN_EPS]
    if mode == BACK:
        return [pen / PEN_EPS, -rate / RATE_EPS]
    return [rate / RATE_EPS, (tool.ramp - pen) / PEN_EPS] if mode == RAMP else [rate / RATE_EPS]


def contact_mode(pen: float, rate: float, tool: Tool) -> int:
    if pen <= 0.0:
        return FREE
    if rate <= 0.0:
        return BACK
    return RAMP if pen < tool.ramp else FULL


class Impact:
    """The tool in one mode at a time."""

    def __init__(self, tool: Tool) -> None:
        self.tool, self.mode = tool, Mode()
        self.pitch = 2 * math.pi / tool.lugs
        # A start far before the lug: no lug is ever met (the free spindle).
        self.gap = self.pitch - tool.overlap if tool.start > -self.pitch else math.inf
        self.jsp = tool.jj + tool.n**2 * tool.jm
        self.x_max = tool.lead * (math.hypot(tool.q_max, tool.vertex) - tool.vertex)

    def groove(self, q: float) -> tuple[float, float, float]:
        """x, s = dx/dq, s' = ds/dq of the rounded vertex."""
        root = math.hypot(q, self.tool.vertex)
        return (
            self.tool.lead * (root - self.tool.vertex),
            self.tool.lead * q / root,
            self.tool.lead * self.tool.vertex**2 / root**3,
        )

    def flank(self, y: np.ndarray) -> float:
        """Angle of the hammer's lug flank in front of the forward flank of lug index + 1 (GAP,
        CLEAR) or of lug index (OVER).
        """
        lug = self.mode.index - (1 if self.mode.lugs == OVER else 0)
        return y[THS] - y[THA] - lug * self.pitch

    def touches(self, y: np.ndarray) -> dict[str, tuple[float, float]]:
        """Penetration m and its rate m/s of each contact that is possible in the mode."""
        tool, x_s = self.tool, self.groove(y[THJ] - y[THS])
        x, dx = x_s[0], x_s[1] * (y[WJ] - y[WS])
        found = {"stop": (x - self.x_max, dx)}
        if self.mode.lugs == GAP:
            phi, rate = self.flank(y), y[WS] - y[WA]
            found["forward"] = (tool.r_lug * phi, tool.r_lug * rate)
            found["rear"] = (tool.r_lug * (-self.gap - phi), -tool.r_lug * rate)
        if self.mode.lugs == OVER:
            found["top"] = (tool.h - x, -dx)
        return found

    def limits(self, y: np.ndarray) -> tuple[float, float]:
        """Slip torques forwards and backwards, N m."""
        return self.tool.slip(y[THA] - y[E])

    def joint(self, y: np.ndarray) -> float:
        forward, backward = self.limits(y)
        sticking = self.tool.kj * y[E] + self.tool.cj * y[WA]
        return (
            sticking
            if self.mode.joint == STICK
            else (forward if self.mode.joint == FORWARD else -backward)
        )

    def forces(self, y: np.ndarray) -> tuple[float, float]:
        """Torque on the hammer's lugs (Tlug, N m) and axial contact force on the hammer (Faxial, N,
        end stop positive).
        """
        touch, mode, tool = self.touches(y), self.mode, self.tool
        axial = push(*touch["stop"], mode.stop, tool)
        if mode.lugs == GAP:
            lug = push(*touch["forward"], mode.forward, tool) - push(
                *touch["rear"], mode.rear, tool
            )
            return tool.r_lug * lug, axial
        if mode.lugs == OVER:
            axial -= push(*touch["top"], mode.top, tool)
        return 0.0, axial

    def drive(self, y: np.ndarray) -> float:
        """Torque of motor and running friction at the spindle, N m."""
        t = self.tool
        return t.n * (t.kt * y[I] - t.b * t.n * y[WJ] - t.tc * self.mode.spin)

    def accelerations(self, y: np.ndarray) -> tuple[float, float, float]:
        """Spindle and hammer from the 2x2 mass matrix, rad/s^2, and the torque that holds the
        spindle at rest beyond the drive.
        """
        t, lug_axial = self.tool, self.forces(y)
        x, s, ds = self.groove(y[THJ] - y[THS])
        axial = t.f0 + t.k * x + lug_axial[1] + t.m * ds * (y[WJ] - y[WS]) ** 2
        drive, hammer, ms2 = self.drive(y), s * axial - lug_axial[0], t.m * s * s
        if self.mode.spin == 0.0:
            a_s = hammer / (t.js + ms2)
            return 0.0, a_s, drive - s * (axial - t.m * s * a_s)
        spindle = drive - s * axial
        det = (self.jsp + ms2) * (t.js + ms2) - ms2 * ms2
        return (
            ((t.js + ms2) * spindle + ms2 * hammer) / det,
            (ms2 * spindle + (self.jsp + ms2) * hammer) / det,
            0.0,
        )

    def housing(self, y: np.ndarray, spindle_acceleration: float) -> float:
        """Reaction of stator, ring gear and bearings, N m."""
        held = 0.0 if self.mode.spin else self.accelerations(y)[2]
        return (
            self.drive(y)
            - held
            - (self.tool.n - 1) * self.tool.jm * self.tool.n * spindle_acceleration
        )

    def duty(self, t: float) -> float:
        """The command, or that of the diodes: their current flows against the bus."""
        if self.mode.stopped:
            return -self.mode.diode
        return (
            min(self.tool.duty, self.tool.slew * t)
            if math.isfinite(self.tool.slew)
            else self.tool.duty
        )

    def rhs(self, time_s: float, y: np.ndarray) -> np.ndarray:
        t, duty = self.tool, self.duty(time_s)
        bus = t.voc - t.rs * duty * y[I]
        a_j, a_s, _ = self.accelerations(y)
        torque = self.joint(y)
        a_a = (self.forces(y)[0] - torque) / t.ja
        twist = y[WA] if self.mode.joint == STICK else (torque - t.kj * y[E]) / t.cj
        blocked = self.mode.stopped and t.coast and self.mode.diode == 0.0
        current = 0.0 if blocked else (duty * bus - t.r * y[I] - t.kt * t.n * y[WJ]) / t.l
        return np.array(
            [current, y[WJ], a_j, y[WS], a_s, y[WA], a_a, twist, y[I], bus, self.housing(y, a_j)]
        )

    def joint_margins(self, y: np.ndarray) -> list[float]:
        forward, backward = self.limits(y)
        if not math.isfinite(forward):
            return []
        sticking = self.tool.kj * y[E] + self.tool.cj * y[WA]
        above, below = (sticking - forward) / TORQUE_EPS, (-backward - sticking) / TORQUE_EPS
        return [
            above if self.mode.joint == FORWARD else -above,
            below if self.mode.joint == BACKWARD else -below,
        ]

    def margins(self, y: np.ndarray) -> list[float]:
        """All above -1 while the mode holds."""
        mode, t = self.mode, self.tool
        found: list[float] = []
        for name, (pen, rate) in self.touches(y).items():
            found += contact_margins(pen, rate, getattr(mode, name), t)
        height = (self.groove(y[THJ] - y[THS])[0] - t.h) / PEN_EPS
        phi = self.flank(y)
        if mode.lugs == GAP:
            found.append(-height)
        elif mode.lugs == CLEAR:
            found += [height, -phi / ANGLE_EPS, (phi + self.gap) / ANGLE_EPS]
        else:
            found += [phi / ANGLE_EPS, (t.overlap - phi) / ANGLE_EPS]
        found += self.joint_margins(y)
        if mode.diode:
            found.append(mode.diode * y[I] / CURRENT_EPS)
        held = t.n * t.tc - abs(self.accelerations(y)[2])
        found.append(held / TORQUE_EPS if mode.spin == 0.0 else mode.spin * y[WJ] / RATE_EPS)
        return found

    def pass_lugs(self, y: np.ndarray) -> None:
        """Set the state "in a gap, above the lugs or over a lug" after one of its margins was
        passed.
        """
        mode, below = self.mode, self.groove(y[THJ] - y[THS])[0] < self.tool.h
        phi = self.flank(y)
        if mode.lugs == OVER:
            if 0.0 <= phi <= self.tool.overlap:
                return
            mode.index -= 1 if phi < 0.0 else 0
            mode.lugs = GAP if below else CLEAR
            return
        if mode.lugs == GAP and below:
            return
        if phi > 0.0 or phi < -self.gap:
            mode.index += 1 if phi > 0.0 else 0
            mode.lugs = OVER
        else:
            mode.lugs = GAP if below else CLEAR

    def switch(self, y: np.ndarray) -> int | None:
        """Set all modes from the state just beyond a margin; return the number of the lug whose
        flank has just been touched, or None.
        """
        mode, t = self.mode, self.tool
        was_touching = mode.lugs == GAP and (mode.forward != FREE or mode.rear != FREE)
        self.pass_lugs(y)
        touch = self.touches(y)
        for name in ("forward", "rear", "top", "stop"):
            setattr(mode, name, contact_mode(*touch[name], t) if name in touch else FREE)
        forward, backward = self.limits(y)
        sticking = t.kj * y[E] + t.cj * y[WA]
        mode.joint = (
            FORWARD if sticking > forward else (BACKWARD if sticking < -backward else STICK)
        )
        if mode.diode * y[I] < 0.0:
            mode.diode, y[I] = 0.0, 0.0
        if mode.spin * y[WJ] <= 0.0:
            mode.spin, y[WJ] = 0.0, 0.0
            held = self.accelerations(y)[2]
            mode.spin = math.copysign(1.0, held) if abs(held) > t.n * t.tc else 0.0
        if was_touching or mode.lugs != GAP or mode.forward == mode.rear == FREE:
            return None
        return mode.index if mode.forward != FREE else mode.index - 1

    def row(self, t: float, y: np.ndarray) -> list[float]:
        """The COLUMNS at one instant."""
        tool = self.tool
        hammer_mm = 1e3 * self.groove(y[THJ] - y[THS])[0]
        return [
            t,
            y[CHARGE],
            y[BUS],
            y[I],
            tool.n * y[WJ],
            tool.n * (y[THJ] - tool.start),
            self.joint(y),
            y[THA],
            y[THA] - y[E],
            hammer_mm,
            y[THS] - tool.start,
            y[TURN],
        ]


def kind_of(blows: list[Contact], lug: int, t: float, approach: float) -> int:
    """Section 4: blow, repeat or rebound."""
    if not blows or lug != blows[-1].lug:
        return BLOW
    last = blows[-1]
    return (
        REPEAT
        if t - last.time_s > REPEAT_AFTER_S and approach >= REPEAT_SPEED * last.approach_rad_s
        else REBOUND
    )


def first_violation(
    plant: Impact, dense: Callable[[float], np.ndarray], t0: float, t1: float
) -> float:
    """The instant in (t0, t1] where the first margin passes -1, on the far side of it."""

    def lowest(t: float) -> float:
        return min(plant.margins(dense(t))) + 1.0

    if lowest(t0) <= 0.0:
        return t0
    found, beyond = brentq(lowest, t0, t1, xtol=1e-15, rtol=1e-15), 1e-16
    while lowest(found) > 0.0 and found < t1:
        found, beyond = min(found + beyond, t1), 2 * beyond
    return found


def torque_peak(before: list[float], after: list[float]) -> float:
    """Largest joint torque of a step, by the cubic through torques and slopes at its ends."""
    (t0, p0, d0), (t1, p1, d1) = before, after
    if not d0 > 0.0 >= d1:
        return max(p0, p1)
    u, h = np.linspace(0.0, 1.0, 33), t1 - t0
    cubic = (
        (2 * u**3 - 3 * u**2 + 1) * p0
        + (u**3 - 2 * u**2 + u) * h * d0
        + (3 * u**2 - 2 * u**3) * p1
        + (u**3 - u**2) * h * d1
    )
    return float(np.max(cubic))


def torque_slope(plant: Impact, t: float, y: np.ndarray) -> list[float]:
    """Time, joint torque and its slope."""
    dy = plant.rhs(t, y)
    if plant.mode.joint == STICK:
        return [t, plant.joint(y), plant.tool.kj * y[WA] + plant.tool.cj * dy[WA]]
    side, head = (0, 1.0) if plant.mode.joint == FORWARD else (1, -1.0)
    angle, step = y[THA] - y[E], 1e-6
    gradient = (plant.tool.slip(angle + step)[side] - plant.tool.slip(angle - step)[side]) / (
        2 * step
    )
    return [t, plant.joint(y), head * gradient * (dy[THA] - dy[E])]


def note_extremes(
    plant: Impact, out: Result, before: list[float], after: list[float], y: np.ndarray
) -> None:
    """Peak torque of the last contact and the hammer's travel."""
    out.hammer_mm = max(out.hammer_mm, 1e3 * plant.groove(y[THJ] - y[THS])[0])
    if out.contacts:
        other = [[t, -torque, -slope] for t, torque, slope in (before, after)]
        out.contacts[-1].peak_nm = max(
            out.contacts[-1].peak_nm, torque_peak(before, after), torque_peak(*other)
        )


def stretch(
    plant: Impact, y: np.ndarray, t: float, end: float, out: Result, method: str, rtol: float
) -> tuple[np.ndarray, float, bool]:
    """Integrate in the present mode until a margin ends it (True) or `end`."""
    solver = SOLVERS[method](
        plant.rhs, t, y, end, rtol=rtol, atol=ATOL * rtol / RTOL, max_step=MAX_STEP_S
    )
    slope = torque_slope(plant, t, y)
    while solver.status == "running":
        message = solver.step()
        if solver.status == "failed":
            raise ArithmeticError(message)
        t, y = solver.t, solver.y
        left = min(plant.margins(y)) <= -1.0
        if left:
            dense = solver.dense_output()
            t = first_violation(plant, dense, solver.t_old, solver.t)
            y = dense(t)
        before, slope = slope, torque_slope(plant, t, y)
        note_extremes(plant, out, before, slope, y)
        if left:
            return y.copy(), t, True
    return y.copy(), t, False


def simulate(
    tool: Tool, seconds: float, method: str = "DOP853", rtol: float = RTOL, row_s: float = 1e-3
) -> Result:
    """A run of the tool from rest, with its duty, slew and stop; rows every row_s from 0 on."""
    plant, out = Impact(tool), Result()
    y, t = np.zeros(11), 0.0
    y[THJ] = y[THS] = tool.start
    out.rows.append(plant.row(t, y))
    for row in range(1, round(seconds / row_s) + 1):
        if t >= tool.stop_s - 1e-9 and not plant.mode.stopped:
            plant.mode.stopped, plant.mode.diode = (
                True,
                math.copysign(1.0, y[I]) if tool.coast else 0.0,
            )
        while t < row * row_s:
            y, t, left = stretch(plant, y, t, row * row_s, out, method, rtol)
            lug = plant.switch(y) if left else None
            if lug is not None:
                approach = abs(float(y[WS] - y[WA]))
                out.contacts.append(
                    Contact(t, lug, kind_of(out.blows(), lug, t, approach), approach)
                )
        out.rows.append(plant.row(t, y))
    return out


def as_json(case: Case, result: Result) -> dict:
    """One case of the file, twelve digits."""

    def short(value: float) -> float:
        return float(f"{value:.12g}")

    contacts = [
        [short(c.time_s), c.lug, c.kind, short(c.approach_rad_s), short(c.peak_nm)]
        for c in result.contacts
    ]
    return {
        "changes": case.changes,
        "seconds": case.seconds,
        "hammer_mm": short(result.hammer_mm),
        "contacts": contacts,
        "rows": [[short(v) for v in row] for row in result.rows],
    }


def make(method: str, rtol: float, names: list[str]) -> dict:
    """The content of the file; with names only those cases are run, the others are kept."""
    kept = json.loads(RESULTS.read_text())["cases"] if names else {}
    run = {
        name: as_json(
            CASES[name], simulate(CASES[name].tool(), CASES[name].seconds, method, rtol, ROW_S)
        )
        for name in names or CASES
    }
    return {
        "made_by": f"python tests/python/impact_reference.py ({method}, rtol {rtol:g})",
        "columns": COLUMNS,
        "contact_columns": [f.name for f in dataclasses.fields(Contact)],
        "cases": {name: (kept | run)[name] for name in CASES},
    }


if __name__ == "__main__":
    text = json.dumps(make("Radau", RTOL, sys.argv[1:]), separators=(",", ":"))
    RESULTS.write_text(text.replace('"slip', '\n"slip').replace("],[", "],\n[") + "\n")
