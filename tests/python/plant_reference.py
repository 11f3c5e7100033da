"""Independent reference of the drivetrain: docs/spec/model.md, sections 1 to 3, and
docs/spec/gap.md, section 3, in SciPy at rtol 1e-10.

Written from those two pages alone; shares no code with plant/. It is slow: every stretch in which
command and load are straight lines is one or more calls of solve_ivp, ended by an event wherever a
body stops or breaks away or the diodes block.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp

RTOL = 1e-10
G = 9.81
I, W, TH, QI, QV, CHARGE, POL, HEAT, IF, WF, W2, TH2 = range(12)  # noqa: E741


@dataclass
class Log:
    """Rows as docs/spec/gap.md, section 1, reads them; command, load and coast are those of the row
    that ends at time_s.
    """

    time_s: np.ndarray
    command: np.ndarray
    kind: str = "duty"
    slew_per_s: float | None = None
    load_nm: np.ndarray | None = None
    coast: np.ndarray | None = None
    supply_v: np.ndarray | None = None
    load_kind: str = "none"


@dataclass
class Tool:
    """Nominal keys of a rig, in the symbols of docs/spec/model.md and SI units, and the effects
    that are on, {id: {parameter: value}}.
    """

    voltage: float = 18.5
    supply_ohm: float = 0.1
    pwm_hz: float = 20000.0
    r: float = 0.19
    l: float = 1e-4  # noqa: E741
    k: float = 0.0109
    j: float = 1.6e-5
    b: float = 4.5e-6
    tc: float = 0.012
    n: float = 5.6
    j_out: float = 6e-5
    mass: float = 0.0
    length: float = 0.0
    zero: float = 0.0
    # law of a free load: tc, tbrk, w_brk, f; the exponential form has w_th, cv instead of w_brk
    free: dict[str, float] = field(default_factory=dict)
    effects: dict[str, dict[str, float]] = field(default_factory=dict)

    def on(self, name: str) -> dict[str, float] | None:
        return self.effects.get(name)

    def get(self, name: str, parameter: str, off: float = 0.0) -> float:
        return self.effects.get(name, {}).get(parameter, off)


def free_nm(
    w: float,
    tc: float,
    tbrk: float,
    w_brk: float = 0.0,
    f: float = 0.0,
    w_th: float = 0.0,
    cv: float = 0.0,
) -> float:
    """docs/spec/model.md, section 3: the Stribeck form, or with w_th the exponential one."""
    if w_th:
        at = max(abs(w), w_th)
        torque = tc + (tbrk - tc) * np.exp(-cv * at) + f * at
        return float(np.sign(w) * torque * min(abs(w) / w_th, 1.0))
    share = w / (np.sqrt(2) * w_brk)
    return float(
        np.sqrt(2 * np.e) * (tbrk - tc) * np.exp(-(share**2)) * share
        + tc * np.tanh(10 * w / w_brk)
        + f * w
    )


def command_stretches(log: Log, tool: Tool) -> list[tuple[float, float, float, float, bool]]:
    """Stretches of the command in true time since the first row: start, end, value at start, value
    at end, open.
    """
    t = log.time_s - log.time_s[0]
    skew = 1 + tool.get("clock_skew", "relative")
    delay = tool.get("transport_delay", "delay_s")
    pieces = [
        (-1e9, 0.0, log.command[0], log.command[0], bool(log.coast is not None and log.coast[0]))
    ]
    for row in range(1, len(t)):
        first, last = log.command[row], log.command[row]
        if log.slew_per_s and abs(last - log.command[row - 1]) <= log.slew_per_s * (
            t[row] - t[row - 1]
        ) * (1 + 1e-9):
            first = log.command[row - 1]
        pieces.append(
            (t[row - 1], t[row], first, last, bool(log.coast is not None and log.coast[row]))
        )
    pieces.append((t[-1], 1e9, log.command[-1], log.command[-1], pieces[-1][4]))
    return [
        (a / skew + delay, b / skew + delay, first, last, coast)
        for a, b, first, last, coast in pieces
    ]


class Drivetrain:
    """Right-hand side on one stretch with fixed modes."""

    def __init__(self, tool: Tool, log: Log) -> None:
        self.tool, self.log = tool, log
        t = tool
        self.n = t.n
        self.k = t.k * (1 + t.get("torque_constant", "relative"))
        self.l = t.l * (1 + t.get("inductance", "relative"))
        self.r = t.r * (1 + t.get("winding_resistance", "relative"))
        self.rs = t.supply_ohm + t.get("supply_resistance", "resistance_ohm")
        j1 = t.j + t.get("added_inertia", "kg_m2")
        pendulum = t.mass * t.length**2 if log.load_kind == "pendulum" else 0.0
        j2 = (t.j_out + pendulum) / t.n**2
        self.play = t.get("gear_backlash", "play_rad") * t.n / 2
        coupler = t.on("coupler_compliance")
        self.two = coupler is not None or self.play > 0
        if coupler:
            j2 += coupler["inertia_kg_m2"]
            self.kc = coupler["stiffness_nm_per_rad"]
            self.cc = 2 * coupler["damping_ratio"] * np.sqrt(self.kc * j2)
        # docs/plant.md: the contact of play alone, 8000 rad/s and damping ratio 0.15 of the reduced
        # inertia
        elif self.two:
            reduced = j1 * j2 / (j1 + j2)
            self.kc, self.cc = 8000.0**2 * reduced, 2 * 0.15 * 8000.0 * reduced
        self.j1, self.j2 = (j1, j2) if self.two else (j1 + j2, 0.0)
        self.s1 = self.s2 = self.diode = 0.0
        self.u0 = self.du = self.tl0 = self.dtl = self.t0 = self.bus = 0.0
        self.open = False
        self.slack_nm = 1e-12  # a body at rest slides where its drive exceeds the hold by this

    def ripple(self, d: float, vs: float) -> float:
        return max(0.2, abs(d) * (1 - abs(d)) * vs / (2 * self.l * self.tool.pwm_hz))

    def constant(self, i: float) -> float:
        sat = self.tool.on("magnetic_saturation")
        return self.k / (1 + (i / sat["saturation_a"]) ** 2) if sat else self.k

    def electrical(self, t: float, y: np.ndarray) -> dict[str, float]:
        tool, log = self.tool, self.log
        u = self.u0 + self.du * (t - self.t0)
        i = u if log.kind == "current_a" else y[I]
        voc = tool.voltage
        if tool.on("supply_droop"):
            voc -= tool.effects["supply_droop"]["volt_per_coulomb"] * y[CHARGE] + y[POL]
        r = self.r * (1 + 0.0039 * y[HEAT])
        d = -self.diode if self.open else u
        measured = log.supply_v is not None
        vs = self.bus if measured else voc
        if log.kind == "current_a":
            return {
                "i": i,
                "vs": vs,
                "v": 0.0,
                "brush": 0.0,
                "r": r,
                "ibus": 0.0,
                "voc": vs,
                "dead": 0.0,
            }
        if log.kind == "voltage_v":
            v = d * vs if self.open else u
            ripple, ibus, dead = 0.2, 0.0, 0.0
        else:
            ibus = d * i
            vs = vs if measured else voc - self.rs * ibus
            ripple = self.ripple(d, vs)
            v = d * vs - tool.get("bridge_resistance", "resistance_ohm") * i
            dead = 0.0
            if tool.on("dead_time") and 0 < abs(d) < 1:
                at_edges = [np.clip((i + way * ripple) / 0.2, -1, 1) for way in (-1, 1)]
                sign = (
                    np.mean(at_edges)
                    if tool.get("dead_time", "at_edges")
                    else np.clip(i / ripple, -1, 1)
                )
                dead = 2 * tool.effects["dead_time"]["dead_time_s"] * tool.pwm_hz * vs * float(sign)
            v -= dead
        brush = 0.0
        if tool.on("brush_drop"):
            up, low = (i + ripple) / 0.3, (i - ripple) / 0.3
            brush = (
                tool.effects["brush_drop"]["voltage_v"]
                * 0.3
                / (2 * ripple)
                * (np.logaddexp(up, -up) - np.logaddexp(low, -low))
            )
        return {
            "i": i,
            "vs": vs,
            "v": v,
            "brush": brush,
            "r": r,
            "ibus": ibus,
            "voc": self.bus if measured else voc,
            "dead": dead,
        }

    def load(self, t: float, y: np.ndarray) -> tuple[float, float]:
        """Opposing torque, and that of a pendulum or a free load's friction, both at the motor
        shaft.
        """
        opposing = (
            (self.tl0 + self.dtl * (t - self.t0)) / self.n
            if self.log.load_kind == "torque"
            else 0.0
        )
        if self.log.load_kind == "free":
            return opposing, free_nm(
                (y[W2] if self.two else y[W]) / self.n, **self.tool.free
            ) / self.n
        if self.log.load_kind != "pendulum":
            return opposing, 0.0
        angle = (y[TH2] if self.two else y[TH]) / self.n
        return opposing, self.tool.mass * G * self.tool.length * np.sin(
            angle - self.tool.zero
        ) / self.n

    def coupler(self, y: np.ndarray) -> float:
        twist, slip = y[TH] - y[TH2], y[W] - y[W2]
        if not self.play:
            return self.kc * twist + self.cc * slip
        if abs(twist) <= self.play:
            return 0.0
        torque = self.kc * (twist - np.sign(twist) * self.play) + self.cc * slip
        return max(torque, 0.0) if twist > 0 else min(torque, 0.0)

    def limits(self, tl: float) -> tuple[float, float]:
        t = self.tool
        c = (
            t.tc
            + t.get("coulomb_friction", "torque_nm")
            + t.get("stribeck_friction", "breakaway_nm")
        )
        c += t.get("load_dependent_friction", "relative") * abs(tl)
        return c + t.get("asymmetric_friction", "forward_nm"), c + t.get(
            "asymmetric_friction", "backward_nm"
        )

    def friction(self, t: float, w: float, s: float, tl: float) -> float:
        tool = self.tool
        c = (
            tool.tc
            + tool.get("coulomb_friction", "torque_nm")
            + tool.get("load_dependent_friction", "relative") * abs(tl)
        )
        if tool.on("stribeck_friction"):
            e = tool.effects["stribeck_friction"]
            c += e["breakaway_nm"] * np.exp(-((w / e["speed_rad_s"]) ** 2))
        torque = c * s + tool.b * w + tool.get("viscous_friction", "nm_s_per_rad") * w
        torque += tool.get("quadratic_drag", "nm_s2_per_rad2") * w * abs(w)
        torque += tool.get("directional_viscous", "nm_s_per_rad") * abs(w)
        torque += (
            tool.get("asymmetric_friction", "forward_nm")
            if s > 0
            else -tool.get("asymmetric_friction", "backward_nm")
        )
        if tool.on("cold_grease"):
            e = tool.effects["cold_grease"]
            torque += e["nm_s_per_rad"] * np.exp(-t / e["time_s"]) * w
        return torque

    def angle_torque(self, th: float) -> float:
        torque = 0.0
        if e := self.tool.on("cogging_torque"):
            torque += e["torque_nm"] * np.sin(e["periods_per_rev"] * th + e.get("phase_rad", 0.0))
        if e := self.tool.on("gear_eccentricity"):
            torque += e["torque_nm"] * np.sin(th / self.n + e.get("phase_rad", 0.0))
        return torque

    def drives(self, t: float, y: np.ndarray) -> tuple[float, float, float, float]:
        """Drive on the motor, drive on the output, opposing torque, whole load torque."""
        e = self.electrical(t, y)
        opposing, pendulum = self.load(t, y)
        motor = self.constant(e["i"]) * e["i"] - self.angle_torque(y[TH])
        if self.two:
            c = self.coupler(y)
            return motor - c, c - pendulum, opposing, opposing + pendulum
        return motor - pendulum, 0.0, opposing, opposing + pendulum

    def rhs(self, t: float, y: np.ndarray) -> np.ndarray:
        dy = np.zeros_like(y)
        e = self.electrical(t, y)
        i, tool = e["i"], self.tool
        k = self.constant(i)
        blocked = self.open and self.diode == 0
        if self.log.kind != "current_a" and not blocked:
            dy[I] = (e["v"] - e["r"] * i - k * y[W] - e["brush"]) / self.l
        drive, drive2, opposing, load = self.drives(t, y)
        rub = self.friction(t, y[W], self.s1, load)
        if self.s1:
            dy[W] = (drive - rub - (0.0 if self.two else self.s1 * opposing)) / self.j1
        if self.two and self.s2:
            dy[W2] = (drive2 - self.s2 * opposing) / self.j2
        dy[TH], dy[TH2] = y[W], y[W2]
        dy[QI] = y[IF] if tool.on("current_lag") else i
        dy[QV] = e["vs"]
        if d := tool.on("supply_droop"):
            dy[CHARGE] = e["ibus"]
            dy[POL] = (d["polarisation_ohm"] * e["ibus"] - y[POL]) / d["polarisation_s"]
        if d := tool.on("winding_heating"):
            dy[HEAT] = d["kelvin_per_joule"] * i * i * e["r"] - y[HEAT] / d["cooling_s"]
        if d := tool.on("current_lag"):
            dy[IF] = (i - y[IF]) / d["time_constant_s"]
        if d := tool.on("speed_lag"):
            if not d.get("lag_form"):
                hall = tool.on("hall_eccentricity")
                seen = (
                    y[W] * (1 + hall["amplitude_rad"] * np.cos(y[TH] + hall.get("phase_rad", 0.0)))
                    if hall
                    else y[W]
                )
                dy[WF] = (seen - y[WF]) / d["time_constant_s"]
        return dy

    def excess(self, drive: float, forward: float, backward: float) -> float:
        return (
            drive - forward if drive > forward else (drive + backward if drive < -backward else 0.0)
        )

    def excesses(self, t: float, y: np.ndarray) -> tuple[float, float]:
        drive, drive2, opposing, load = self.drives(t, y)
        forward, backward = self.limits(load)
        held = max(opposing, 0.0)
        own = 0.0 if self.two else held
        return self.excess(drive, forward + own, backward + own), self.excess(drive2, held, held)

    def events(self, t: float, y: np.ndarray) -> tuple[float, float, float, float]:
        """Each positive before its event, negative after; the last turns positive where the flanks
        of a play meet.
        """
        ex1, ex2 = self.excesses(t, y)
        first = self.s1 * y[W] if self.s1 else self.slack_nm - abs(ex1)
        second = 1.0 if not self.two else (self.s2 * y[W2] if self.s2 else self.slack_nm - abs(ex2))
        third = 1.0
        if self.open:
            third = (
                self.diode * y[I]
                if self.diode
                else self.electrical(t, y)["vs"] - abs(self.k * y[W])
            )
        return first, second, third, abs(y[TH] - y[TH2]) - self.play - 1e-13 if self.play else 1.0

    def decide_rest(self, t: float, y: np.ndarray, shaft: bool, output: bool) -> None:
        if shaft:
            y[W] = 0.0
        if output:
            y[W2] = 0.0
        ex1, ex2 = self.excesses(t, y)
        if shaft:
            self.s1 = float(np.sign(ex1))
        if output:
            self.s2 = float(np.sign(ex2))

    def terminal_events(self) -> list:
        """Terminal events of solve_ivp."""
        found = []
        for which in range(4):

            def event(t: float, y: np.ndarray, which: int = which) -> float:
                return self.events(t, y)[which]

            event.terminal, event.direction = True, (1.0 if which == 3 else -1.0)
            found.append(event)
        return found

    def switch(self, t: float, y: np.ndarray, hit: list[bool], stalled: bool) -> None:
        """Modes after the events that ended a stretch."""
        if hit[2] and self.diode:
            self.diode, y[I] = 0.0, 0.0
        elif hit[2]:
            self.diode = -float(np.sign(y[W]))
        if hit[3] and (y[W] - y[W2]) * (y[TH] - y[TH2]) > 0.0:
            y[TH2] = y[TH] - np.sign(y[TH] - y[TH2]) * (self.play + 1e-12)  # the flanks have met
            hit[0], hit[1] = hit[0] or not self.s1, hit[1] or not self.s2
        if hit[0] or hit[1]:
            self.decide_rest(t, y, hit[0], hit[1])
        # a body that breaks away and stops in the same instant rests until the drive has grown
        if stalled and not hit[3]:
            self.s1, self.s2 = (0.0 if hit[0] else self.s1), (0.0 if hit[1] else self.s2)

    def run(self, t0: float, t1: float, y: np.ndarray, method: str) -> np.ndarray:
        """State after one stretch; the caller has set u0, du, tl0, dtl, t0, open."""
        if not self.open:
            self.diode = 0.0
        elif self.diode == 0:
            self.diode = float(np.sign(y[I]))
        self.decide_rest(t0, y, y[W] == 0.0, self.two and y[W2] == 0.0)
        while t1 - t0 > 1e-13:
            sol = solve_ivp(
                self.rhs,
                (t0, t1),
                y,
                method=method,
                rtol=RTOL,
                atol=1e-9,
                events=self.terminal_events(),
            )
            assert sol.success, sol.message
            stalled = float(sol.t[-1]) - t0 < 1e-13
            self.slack_nm = 100 * self.slack_nm if stalled else 1e-12
            y, t0 = sol.y[:, -1].copy(), float(sol.t[-1])
            self.switch(t0, y, [len(at) > 0 for at in sol.t_events], stalled)
        return y


def settle(m: Drivetrain, y: np.ndarray, t: float) -> None:
    """Set the start: filters at steady state, output side moving with the motor. Its twist carries
    the torque of a rigid shaft; without torque it is in the middle of the play.
    """
    y[IF] = y[I]
    hall = m.tool.on("hall_eccentricity")
    y[WF] = (
        y[W] * (1 + hall["amplitude_rad"] * np.cos(y[TH] + hall.get("phase_rad", 0.0)))
        if hall
        else y[W]
    )
    y[W2], y[TH2] = y[W], y[TH]
    m.s1 = m.s2 = float(np.sign(y[W]))
    if not m.two:
        return
    opposing, pendulum = m.load(t, y)
    load = pendulum + m.s1 * opposing
    torque = load
    if m.s1:
        k = m.constant(y[I])
        free = k * y[I] - m.angle_torque(y[TH]) - m.friction(t, y[W], m.s1, opposing + pendulum)
        torque = (free * m.j2 + load * m.j1) / (m.j1 + m.j2)
    y[TH2] -= torque / m.kc + float(np.sign(torque)) * m.play


def simulate(
    tool: Tool, log: Log, start: tuple[float, float, float], method: str = "DOP853"
) -> dict[str, np.ndarray]:
    """One run from the first row; columns as vgroove._core.simulate_log names them."""
    m = Drivetrain(tool, log)
    own_clock = bool(tool.get("clock_skew", "command_clock"))
    row_scale = 1.0 if own_clock else 1 / (1 + tool.get("clock_skew", "relative"))
    stamps = (log.time_s - log.time_s[0]) * row_scale
    pieces = command_stretches(log, tool)
    gain = 1 + tool.get("supply_gain", "relative")
    y = np.zeros(12)
    y[:3] = start
    load = np.zeros_like(stamps) if log.load_nm is None else log.load_nm
    m.tl0 = load[0]
    m.bus = 0.0 if log.supply_v is None else log.supply_v[0] / gain
    settle(m, y, 0.0)
    states = [y.copy()]
    for row in range(1, len(stamps)):
        a, b = stamps[row - 1], stamps[row]
        y[[QI, QV]] = 0.0
        m.bus = 0.0 if log.supply_v is None else log.supply_v[row] / gain
        m.dtl = (load[row] - load[row - 1]) / (b - a)
        for start_s, end_s, first, last, coast in pieces:
            lo, hi = max(a, start_s), min(b, end_s)
            if hi - lo <= 1e-12:
                continue
            m.t0, m.open = lo, coast
            m.du = (last - first) / (end_s - start_s) if first != last else 0.0
            m.u0 = first + m.du * (lo - start_s) if first != last else last
            m.tl0 = load[row - 1] + m.dtl * (lo - a)
            y = m.run(lo, hi, y, method)
        states.append(y.copy())
    return columns(tool, log, stamps, np.array(states), start)


def columns(
    tool: Tool, log: Log, stamps: np.ndarray, y: np.ndarray, start: tuple[float, float, float]
) -> dict[str, np.ndarray]:
    dt = np.diff(stamps)
    mean = np.concatenate([[start[0]], y[1:, QI] / dt])
    bus = np.concatenate([[np.nan], y[1:, QV] / dt])
    gain, offset = 1 + tool.get("current_gain", "relative"), tool.get("current_offset", "offset_a")
    limit = tool.get("current_saturation", "limit_a", np.inf)
    speed, angle = y[:, W], y[:, TH]
    if hall := tool.on("hall_eccentricity"):
        a, phase = hall["amplitude_rad"], hall.get("phase_rad", 0.0)
        speed, angle = speed * (1 + a * np.cos(angle + phase)), angle + a * np.sin(angle + phase)
    if (lag := tool.on("speed_lag")) and not lag.get("lag_form"):
        speed, angle = y[:, WF], angle - lag["time_constant_s"] * y[:, WF]
    gain_w = 1 + tool.get("speed_gain", "relative")
    return {
        "current_a": np.clip(mean * gain + offset, -limit, limit),
        "supply_v": bus * (1 + tool.get("supply_gain", "relative")),
        "speed_rad_s": y[:, W],
        "speed_measured_rad_s": speed * gain_w,
        "angle_rad": y[:, TH],
        "angle_measured_rad": angle * gain_w,
        "states": y,
    }
