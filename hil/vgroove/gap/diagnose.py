"""log + rig -> locate -> hypotheses -> fit -> verdict: the whole diagnosis of one tool's logs, as a
verdict of the contract.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vgroove.errors import VgrooveError
from vgroove.gap.catalogue import BY_ID, CATALOGUE, Scales, available
from vgroove.gap.fitting.fit import Engine, Fit
from vgroove.gap.next_run import experiment_design
from vgroove.gap.residual.magnitude import robust_magnitude
from vgroove.gap.residual.problem import Problem, load_problem
from vgroove.gap.selection import search
from vgroove.gap.selection.intervals import Estimate, in_catalogue_form, over_long_stretches
from vgroove.gap.selection.search_state import Rows, Search, begin
from vgroove.gap.selection.single_effects import align_to_selection
from vgroove.gap.verdict import decision, location
from vgroove.rig import Rig

SCHEMA = "vgroove.gap/1"
RPM = np.pi / 30.0
MEMORY_S = 2.0
SMOOTH = 21
BOTH_WAYS = 0.05


@dataclass
class Diagnosis:
    """The verdict (JSON of the contract) and what reports draw from."""

    verdict: dict[str, Any]
    problem: Problem
    search: Search
    estimate: Estimate

    @property
    def shown(self) -> Fit:
        """The fit whose numbers are reported."""
        return self.estimate.fit

    def theta(self) -> np.ndarray:
        """Parameter vector (P,) of the corrected model."""
        return self.shown.theta(self.problem.theta0)

    def corrected_rig(self) -> Rig:
        """The rig with the retuned keys and the selected effects."""
        problem = self.problem
        values = {key: float(v) for key, v in self.verdict["retuned_parameters"].items()}
        owners = dict.fromkeys(
            [*self.shown.ids, *(p.of for i in self.shown.ids for p in BY_ID[i].parameters if p.of)]
        )
        effects = {i: effect_table(problem, self.shown, i) for i in owners}
        return problem.rig.with_values(values).with_effects(effects)


def diagnose(
    logs: Sequence[Any],
    rig: Rig,
    seed: int = 0,
    without: Sequence[str] = (),
    tell: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Diagnose logs (paths or Log objects) of one tool against its rig; VgrooveError for unusable
    input or an unknown id in without.
    """
    for name in without:
        if name not in BY_ID:
            raise VgrooveError(
                f"--without: {name} is not in the catalogue of this diagnosis ({', '.join(e.id for e in CATALOGUE)})"
            )
    problem = load_problem(logs, rig)
    kinds = kinds_of(problem)
    engine = Engine(problem, scales_of(problem), rig.tolerance, frozenset(rig.effects))
    rows = Rows(problem.log, problem.time_s, problem.signal, problem.conditional, problem.restart_s)
    state = begin(engine, available(kinds, frozenset(without)), rows, seed, tell)
    state.without = frozenset(without)
    best, rivals = search.run(state)
    best, problem = align_to_selection(state, problem, best), state.engine.problem
    tell("what is left, and where it lies")
    drivers = drivers_of(problem, best.theta(problem.theta0))
    left = location.remaining(
        state, best, drivers, problem.signal, [s.column for s in problem.signals], problem.floor()
    )
    finding = decision.decide(state, best, rivals, left, problem.floor())
    shown = shown_of(state, finding)
    estimate = over_long_stretches(problem, state.engine, shown) or decision.estimate_of(
        state, shown
    )
    return Diagnosis(
        assemble(problem, state, finding, kinds, without, drivers, shown, estimate),
        problem,
        state,
        estimate,
    )


def shown_of(state: Search, finding: decision.Finding) -> Fit:
    """The fit behind `after`: the selected set in the contract's forms, or retuning alone where
    nothing is named.
    """
    return (
        state.retuned
        if finding.verdict in ("none", "unlisted")
        else in_catalogue_form(state, finding.best)
    )


def assemble(
    problem: Problem,
    state: Search,
    finding: decision.Finding,
    kinds: frozenset[str],
    without: Sequence[str],
    drivers: dict[str, np.ndarray],
    shown: Fit,
    estimate: Estimate,
) -> dict[str, Any]:
    """The verdict as the contract's JSON."""
    floor = problem.floor()
    share = location.shapley_shares(state, finding.best, floor) if finding.verdict != "none" else {}
    known = {k: v for k, v in share.items() if k != "unexplained"}
    same = decision.indistinguishable(problem, state, finding, kinds, floor)
    out = {
        "schema": SCHEMA,
        "verdict": finding.verdict,
        "selected": decision.selected(state, problem, finding, floor),
        "gap": decision.gap_section(problem, state, shown, floor),
        "where": {
            "subsystem": max(known, key=lambda k: (known[k], k)) if any(known.values()) else None,
            "share": share,
            "by_regime": location.by_regime(state, problem.regime, problem.regimes),
            "by_correlate": location.by_correlate(
                state, drivers, problem.signal, [s.column for s in problem.signals], floor
            ),
        },
        "effects": decision.effects_section(problem, state, finding, floor, estimate),
        "indistinguishable": [o for o in same if o["id"] not in without],
        "retuned_parameters": estimate.tolerated(),
        "next_experiment": experiment_design.propose(problem, state, finding),
        "unexplained": unexplained_section(problem, state, finding),
        "warnings": list(problem.warnings),
    }
    return plain(out)


def unexplained_section(
    problem: Problem, state: Search, finding: decision.Finding
) -> dict[str, Any]:
    """What is left, what it follows, and what a smooth correction over that would gain: its points
    are in the signal's unit.
    """
    left = finding.left
    sigma = next((s.sigma for s in problem.signals if s.column == left.signal), 1.0)
    return {
        "significant": left.significant,
        "best_correlate": left.best_correlate,
        "signal": left.signal,
        "share_of_squared_gap": left.gain / max(state.score(state.nominal), 1e-9),
        "looks_like": left.looks_like,
        "could_gain": left.could_gain,
        "correction": [[x, y * sigma] for x, y in left.correction],
    }


def plain(value: Any) -> Any:
    """The same as Python numbers, with enough digits and not more, so that the text does not hang
    on the last bit.
    """
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if isinstance(value, bool | np.bool_):
        return bool(value)
    if isinstance(value, float | np.floating):
        return float(f"{float(value):.10g}")
    return int(value) if isinstance(value, np.integer) else value


def effect_table(problem: Problem, one: Fit, effect_id: str) -> dict[str, Any]:
    """[effects.<id>] of a rig: all parameters of the fit, phases and forms included."""
    theta, effect = one.theta(problem.theta0), BY_ID[effect_id]
    table: dict[str, Any] = {
        p.name: float(theta[problem.index(effect.name(p))]) for p in effect.parameters if not p.of
    }
    if effect_id == "hall_dropout":
        table["probability"] = problem.missed_share
    if effect.form and theta[problem.index(effect.flag_name)] == 1.0:
        table[effect.form.key] = effect.form.words[1]
    return table


def column(problem: Problem, name: str) -> np.ndarray:
    """A column of all logs, joined; empty where no log has it."""
    found = [np.asarray(log.columns[name], float) for log in problem.logs if name in log.columns]
    return np.concatenate(found) if found else np.zeros(0)


def speed_rows(problem: Problem, j: int) -> np.ndarray:
    """Measured motor speed of a log in rad/s per row, from the speed column or the position."""
    log = problem.logs[j]
    if "speed_rpm" in log.columns:
        return filled(np.asarray(log.columns["speed_rpm"], float)) * RPM
    if "position_rad" in log.columns:
        return np.gradient(
            filled(np.asarray(log.columns["position_rad"], float)), np.asarray(log.time_s, float)
        )
    return np.zeros(len(log.time_s))


def filled(values: np.ndarray) -> np.ndarray:
    """Missing samples interpolated."""
    good = np.isfinite(values)
    return (
        np.interp(np.arange(len(values)), np.flatnonzero(good), values[good])
        if good.any()
        else np.zeros(len(values))
    )


def kinds_of(problem: Problem) -> frozenset[str]:
    """What the log can show, in the words of Effect.needs."""
    rig, kind, judged = problem.rig, problem.rig.input["kind"], {s.column for s in problem.signals}
    speed = np.concatenate([speed_rows(problem, j) for j in range(len(problem.logs))])
    moving = np.abs(speed) > 0.02 * max(np.abs(speed).max(), 1e-12)
    back = float((speed[moving] < 0.0).mean()) if moving.any() else 0.0
    torque = np.nanmax(np.abs(column(problem, "load_nm")), initial=0.0) > 0.0
    load = rig.load["kind"] == "pendulum" or (rig.load["kind"] == "torque" and torque)
    reflected = rig.shaft_inertia_kg_m2 / rig.motor["inertia_kg_m2"] - 1.0
    flags = {
        "duty": kind == "duty",
        "voltage": kind != "current_a",
        "current_input": kind == "current_a",
        "current": "current_a" in judged,
        "speed": "speed_rpm" in judged,
        "supply": "supply_v" in judged,
        "edges": any(s.edges for s in problem.signals),
        "both": BOTH_WAYS < back < 1.0 - BOTH_WAYS,
        "load": bool(load),
        "gear": rig.gearbox["ratio"] > 1.0,
        "output": bool(load) or reflected > 0.01,
    }
    return frozenset(name for name, here in flags.items() if here)


def scales_of(problem: Problem) -> Scales:
    """Sizes of effects from what the logs and the rig span."""
    rig, motor = problem.rig, problem.rig.motor
    resistance, k = motor["resistance_ohm"], motor["torque_constant_nm_per_a"]
    volt = robust_magnitude(
        column(problem, "supply_v"),
        rig.supply.get("voltage_v", 0.0) or robust_magnitude(column(problem, "voltage_v"), 1.0),
    )
    amp = robust_magnitude(column(problem, "current_a"), 0.3 * volt / resistance)
    speed = robust_magnitude(
        np.concatenate([speed_rows(problem, j) for j in range(len(problem.logs))]), volt / k
    )
    times = [np.asarray(log.time_s, float) for log in problem.logs]
    interval = float(np.median(np.concatenate([np.diff(t) for t in times])))
    # Whether a measured current belongs to the start or the end of its row is the logger's
    # convention: one sample is no delay.
    least_delay = 1.5 * interval if rig.input["kind"] == "current_a" else 0.0
    return Scales(
        volt=volt,
        amp=amp,
        speed=speed,
        torque=k * amp,
        inertia=rig.shaft_inertia_kg_m2,
        motor_inertia=motor["inertia_kg_m2"],
        resistance=resistance,
        coulomb=motor["coulomb_nm"],
        viscous=motor["viscous_nm_s_per_rad"],
        ratio=rig.gearbox["ratio"],
        duration=float(max(t[-1] - t[0] for t in times)),
        interval=interval,
        least_delay=least_delay,
        pwm_hz=rig.bridge.get("pwm_hz", 20000.0),
        supply_ohm=rig.supply.get("resistance_ohm", 0.0),
    )


def drivers_of(problem: Problem, theta: np.ndarray) -> dict[str, np.ndarray]:
    """What a remainder may follow, per residual row (n,): measured signals, angles of the model
    theta (P,) that restarts with the log's, time, heat, the command and its rate.
    """
    angles = [simulation["angle_rad"][0] for simulation in problem.simulate(theta)]
    tables = [log_drivers(problem, j, angles[j]) for j in range(len(problem.logs))]
    names = set.intersection(*(set(t) for t in tables))
    out = {name: np.full(problem.n, np.nan) for name in sorted(names)}
    for j, table in enumerate(tables):
        rows = problem.log == j
        for name in names:
            out[name][rows] = table[name][problem.row[rows]]
    return out


def log_drivers(problem: Problem, j: int, angle: np.ndarray) -> dict[str, np.ndarray]:
    """Drivers of one log per row; angle (rows,) of the motor."""
    log, ratio = problem.logs[j], problem.rig.gearbox["ratio"]
    t, speed = np.asarray(log.time_s, float), speed_rows(problem, j)
    out = {
        "speed": speed,
        "sign of speed": np.sign(np.where(np.abs(speed) > 1.0, speed, 0.0)),
        "time since start": t - t[0],
        "motor angle": np.mod(angle, 2.0 * np.pi),
        "output angle": np.mod(angle / ratio, 2.0 * np.pi),
        "unwound motor angle": angle,
    }
    current = None
    words = {
        "current_a": "current",
        "duty": "duty",
        "voltage_v": "voltage",
        "supply_v": "bus voltage",
        "load_nm": "load",
    }
    for name, word in words.items():
        if name in log.columns:
            out[word] = smooth(filled(np.asarray(log.columns[name], float)))
            current = out[word] if name == "current_a" else current
    command = out.get("duty", out.get("voltage"))
    if command is not None:
        out["rate of command"] = np.gradient(command, t)
    if current is not None:
        out["heat"] = heat(current, t)
    return out


def smooth(values: np.ndarray) -> np.ndarray:
    """Moving mean, so that a sample's own noise is not what it is explained by."""
    return np.convolve(
        np.pad(values, SMOOTH // 2, mode="edge"), np.full(SMOOTH, 1.0 / SMOOTH), mode="valid"
    )


def heat(current: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Squared current through a first-order memory."""
    out, level = np.zeros(len(t)), 0.0
    for n in range(1, len(t)):
        level += (t[n] - t[n - 1]) * (current[n] ** 2 - level / MEMORY_S)
        out[n] = level
    return out
