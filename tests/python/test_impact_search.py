"""The search for effects of a hammering tool: minima that are apart from each other, effects at one
place of the joint, and nuisance parameters whose first fit ends in a poor minimum.
"""

from dataclasses import replace

import numpy as np
import pytest

from impact_logs import PARAMETERS, impact_rig, plant_log, ramp
from vgroove.gap import DiagnosisOptions
from vgroove.gap.residual.huber import huber_loss
from vgroove.gap.residual.impact import problem as impact_problem
from vgroove.gap.residual.impact import start_angle
from vgroove.gap.residual.impact.impact_run import FirstSpans, ImpactRun
from vgroove.gap.residual.impact.roll_outs import run_up_means
from vgroove.gap.residual.impact.roughness import roughness_responses
from vgroove.gap.residual.impact.start_angle import with_starts
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.residual.problem import Problem
from vgroove.gap.selection.retuned_again import retune_again
from vgroove.gap.selection.search_state import Search
from vgroove.gap.selection.single_effects import fit_single_effects
from vgroove.gap.stages import begin_search
from vgroove.log import Log
from vgroove.rig import Rig, rig_from_dict


def search_over(log: Log, rig: Rig, *ids: str) -> Search:
    """A search over these effects alone."""
    search = begin_search(load_problem([log], rig), DiagnosisOptions())
    return replace(search, effects=[e for e in search.effects if e.id in ids])


def step(duty: float, seconds: float) -> np.ndarray:
    """A duty after 50 ms at rest."""
    return np.concatenate([np.zeros(50), ramp(duty, seconds)])


def fitted(search: Search, name: str) -> float:
    """Fitted parameter, named "effect.parameter", of the fit with this effect alone."""
    theta = search.fits[(name.split(".")[0],)].theta(search.problem.theta0)
    return float(theta[PARAMETERS.index(f"effects.{name}")])


@pytest.mark.parametrize(("begin", "end"), [(6.0, 14.0), (16.0, 26.0)])
def test_a_knot_is_found_at_its_place_and_predicts_the_windows_at_its_ends(
    begin: float, end: float
) -> None:
    """Only the windows at an end of the knot show where it is: a fold without them must not move
    it.
    """
    screw = {"start_nm": 0.9, "end_nm": 11.0, "turns": 26.0, "seat_nm": 22.0, "from_turns": 10.0}
    rig = impact_rig("impact_driver_wood_screw", **{f"load__{k}": v for k, v in screw.items()})
    knot = {"torque_nm": 2.0, "from_rad": begin, "to_rad": end}
    effects = {f"wood_knot.{key}": value for key, value in knot.items()}
    search = search_over(plant_log(rig, effects, 12, step(0.95, 1.6)), rig, "wood_knot")
    assert search.problem.head_rad > end
    search = fit_single_effects(search)
    assert fitted(search, "wood_knot.torque_nm") == pytest.approx(2.0, rel=0.1)
    assert fitted(search, "wood_knot.from_rad") == pytest.approx(begin, abs=0.7)
    assert fitted(search, "wood_knot.to_rad") == pytest.approx(end, abs=0.7)
    assert search.score(search.fits[("wood_knot",)]) < 0.8 < search.score(search.retuned)


def test_lugs_that_are_worn_by_a_quarter_are_found() -> None:
    """The tool hammers in another limit cycle: no slope leads there."""
    rig = impact_rig(load__run_torque_nm=1000.0, load__slip_slope_nm_per_rad=0.0)
    log = plant_log(rig, {"lug_wear.height_m": 1.25e-3}, 3, step(0.8, 1.2))
    search = fit_single_effects(search_over(log, rig, "lug_wear"))
    assert fitted(search, "lug_wear.height_m") == pytest.approx(1.25e-3, rel=0.05)
    assert search.reported_gap(search.fits[("lug_wear",)]) < 1.3


def test_a_poor_minimum_of_the_tolerated_keys_is_not_attributed_to_an_effect() -> None:
    loose = impact_rig().as_dict() | {"tolerance": {"motor.resistance_ohm": 0.05}}
    rig = rig_from_dict(loose, "loose")
    tool = rig.with_values({"motor.resistance_ohm": 1.04 * rig.motor["resistance_ohm"]})
    search = search_over(plant_log(tool, {}, 9, step(0.9, 1.0)), rig, "viscous_friction")
    found = search.retuned
    (plain,) = search.engine.hypotheses([])
    poor = search.engine.fit([replace(plain, start=np.array([-2.0]))], 0)[0]
    search.fits[()] = poor
    effects = search.engine.hypotheses(search.effects, found.x)
    search.fit_and_keep(effects)
    again = retune_again(replace(search, retuned=poor))
    assert again.retuned.cost == pytest.approx(found.cost, rel=0.02)
    assert again.retuned.cost < 0.5 * poor.cost
    assert retune_again(again).retuned is again.retuned


@pytest.mark.parametrize("size", [0.0, 0.3])
def test_single_effects_are_fitted_to_convergence_beside_tolerated_keys(size: float) -> None:
    """Whether retuning leaves a gap (the effect is present) or none."""
    loose = impact_rig().as_dict() | {"tolerance": {"motor.resistance_ohm": 0.02}}
    rig, effect = rig_from_dict(loose, "loose"), {"impact_damping.relative": size}
    log = plant_log(rig, effect, 9, step(0.9, 1.0))
    search = fit_single_effects(search_over(log, rig, "impact_damping", "viscous_friction"))
    for one in (search.fits[(e.id,)] for e in search.effects):
        again = search.engine.fit([replace(one.hypothesis, start=one.x)])[0]
        assert again.cost > one.cost - 2.0 * search.engine.converged_gain(one)
    assert search.fits[("impact_damping",)].exact
    assert search.score(search.fits[("impact_damping",)]) < 1.0


def test_the_standard_deviations_hold_what_is_not_proportional_to_the_roughness() -> None:
    """A joint at whose torque the tool just hammers: by a few per cent more or less the cycle is
    another one, in some windows of the log and not in others.
    """
    joint = {"parallel": 6, "series": 41, "friction": 0.112, "from_turns": 7.05}
    values = {f"load__{key}": value for key, value in joint.items()} | {"supply__voltage_v": 19.6}
    rig = impact_rig("impact_driver_disc_spring", **values)
    problem = load_problem([plant_log(rig, {}, 2, step(0.95, 1.6))], rig)
    run = problem.runs[0]
    rough = roughness_responses(run, problem.of_log(0, problem.theta0[None]))
    share = (rough.curvature / run.sigma)[run.judged & ~run.is_run_up]
    assert np.all(share < 1.02)
    assert np.mean(share > 0.5) > 0.03 and np.mean(share < 0.3) > 0.6


def test_the_start_angle_of_a_set_near_the_rig_takes_few_simulations(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = impact_rig()
    problem = load_problem([plant_log(rig, {}, 5, step(0.9, 1.0))], rig)
    run, plant = problem.runs[0], np.repeat(problem.of_log(0, problem.theta0[None]), 4, axis=0)
    plant[:, PARAMETERS.index("effects.winding_resistance.relative")] = [0.0, 0.02, -0.02, 0.04]
    rows, residuals = [], start_angle.span_residuals

    def counted(run: ImpactRun, spans: FirstSpans, theta: np.ndarray) -> np.ndarray:
        rows.append(len(theta) * len(spans.early.time_s))
        return residuals(run, spans, theta)

    monkeypatch.setattr(start_angle, "span_residuals", counted)
    found = start_angle.profiled_starts(run, plant)
    assert found == pytest.approx(start_angle.predicted_starts(run, plant), abs=0.05)
    assert sum(rows) <= 12 * len(plant) * len(run.early.time_s)


@pytest.mark.parametrize("seed", range(41, 47))
def test_the_loss_of_the_run_up_is_smooth_along_an_effect(seed: int) -> None:
    """Late blows depend on the start angle so steeply that the loss of the whole run-up has many
    minima a few milliradians apart. The search, which lengthens the compared stretch step by step,
    stays in the same one.
    """
    rng = np.random.default_rng(seed)
    rig = impact_rig(load__slip_slope_nm_per_rad=float(rng.uniform(60.0, 400.0)))
    size, name = float(rng.uniform(0.2, 0.4)), "effects.impact_damping.relative"
    log = plant_log(rig, {"impact_damping.relative": size}, seed, step(0.9, 1.0))
    problem = load_problem([log], rig)
    run, sizes = problem.runs[0], size + np.linspace(-0.02, 0.02, 9)
    theta = np.tile(problem.theta0, (9, 1))
    theta[:, PARAMETERS.index(name)] = sizes
    plant = problem.of_log(0, theta)
    tried = with_starts(plant, start_angle.profiled_starts(run, plant))
    loss = np.array(
        [huber_loss(r, start_angle.HUBER_SIGMAS) for r in start_angle.run_up_residuals(run, tried)]
    )
    parabola = np.polyval(np.polyfit(sizes, loss, 2), sizes)
    assert np.abs(loss - parabola).max() < 3.0


@pytest.mark.parametrize("seed", [41, 42, 43])
def test_the_search_follows_the_first_spans_and_ends_at_the_minimum_of_the_whole_run_up(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    rig = impact_rig(load__slip_slope_nm_per_rad=float(rng.uniform(60.0, 400.0)))
    log = plant_log(rig, {}, seed, step(float(rng.uniform(0.75, 1.0)), 1.0))
    problem = load_problem([log], rig)
    run, plant = problem.runs[0], problem.of_log(0, problem.theta0[None])
    counts = [len(spans.run_up.first) for spans in run.search.stages]
    assert counts == sorted(set(counts)) and counts[-1] == len(run.run_up.first)
    kept = run.judged & run.is_run_up
    means = run_up_means(run, plant)[:, run.judged[run.is_run_up]]
    noise = (run.measured[kept] - means) / run.sigma[kept]
    for spans, count in zip(run.search.stages, counts, strict=True):
        mine = run.window[kept] < count
        part = run.nuisance.of_rows((kept & (run.window < count))[run.judged])
        np.testing.assert_allclose(
            start_angle.span_residuals(run, spans, plant), part.whitened(noise[:, mine]), rtol=1e-7
        )
    found = start_angle.profiled_starts(run, plant)[0]
    near = found + np.linspace(-0.01, 0.01, 41)
    loss = huber_loss(
        start_angle.run_up_residuals(run, with_starts(plant[0], near)),
        start_angle.HUBER_SIGMAS,
    )
    assert loss[20] <= loss.min() + 0.5


def test_a_set_that_was_simulated_is_kept_within_the_memory_allowed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig = impact_rig()
    problem = load_problem([plant_log(rig, {}, 5, step(0.9, 1.0))], rig)
    theta = problem.theta0 * (1.0 + 1e-6 * np.arange(4)[:, None])
    first = problem.residuals(theta)
    monkeypatch.setattr(Problem, "residuals", lambda *_: pytest.fail("simulated again"))
    assert np.array_equal(problem.residuals(theta[[3, 0, 0, 2]]), first[[3, 0, 0, 2]])
    monkeypatch.undo()
    monkeypatch.setattr(impact_problem, "KEPT_BYTES", 2 * problem.n * theta.itemsize)
    other = replace(problem)
    assert np.allclose(other.residuals(theta), first, atol=1e-9)
    assert len(other._kept) == 2
    assert np.allclose(other.residuals(theta[::-1]), first[::-1], atol=1e-9)
