"""A verdict as text: in one sentence, and as the lines that the command prints."""

from vgroove.gap.result import Verdict
from vgroove.gap.verdict.schema import EffectFinding

MIN_SHARE_SHOWN = 0.005  # smallest share of a subsystem in the summary: a smaller one rounds to 0 %


def spaced_name(name: str) -> str:
    """An identifier with spaces."""
    return name.replace("_", " ")


def verdict_sentence(verdict: Verdict) -> str:
    """The verdict in one sentence."""
    gap, names = verdict.gap, " and ".join(map(spaced_name, verdict.selected))
    figures = (
        f"gap {gap.before:.2f} before, {gap.retuned:.2f} retuned, {gap.after:.2f} after"
        f" (noise floor {gap.floor:.2f})"
    )
    if verdict.verdict == "none":
        return f"No gap beyond the noise and the stated tolerances: {figures}."
    if verdict.verdict == "unlisted":
        left = verdict.unexplained.best_correlate
        follows = f"; what remains follows {left}" if left else ""
        what = "A real gap" if gap.retuned > gap.floor else "A pattern below the noise floor"
        return f"{what} that no effect of the catalogue closes: {figures}{follows}."
    if verdict.verdict == "ambiguous":
        others = " or ".join(rivals_in_words(verdict))
        return f"Most likely {names}, but {others} would predict these logs as well: {figures}."
    if verdict.verdict == "partial":
        return f"Part of the gap is {names}; a remainder stays that is not explained: {figures}."
    return f"The missing effect is {names}: {figures}."


def rivals_in_words(verdict: Verdict) -> list[str]:
    """The rivals of an ambiguous verdict; where fewer of the named effects predict as well, they
    are the rival.
    """
    return [spaced_name(r.id) for r in verdict.indistinguishable] or ["a part of them"]


def summary_lines(verdict: Verdict) -> list[str]:
    """Sentence, shares of the subsystems, named effects, rivals and next run, a line each."""
    lines = [verdict_sentence(verdict)]
    shares = {k: v for k, v in verdict.where.share.items() if v >= MIN_SHARE_SHOWN}
    if shares:
        ranked = sorted(shares.items(), key=lambda item: -item[1])
        lines.append("where: " + ", ".join(f"{k} {100 * v:.0f} %" for k, v in ranked))
    for effect in (e for e in verdict.effects if e.id in verdict.selected):
        parameters = ", ".join(parameter_texts(effect))
        lines.append(f"{effect.id}: probability {effect.probability:.2f}, {parameters}")
    for other in verdict.indistinguishable:
        lines.append(f"not distinguishable from {other.instead_of} on these logs: {other.id}")
    if verdict.next_experiment:
        proposed = verdict.next_experiment
        lines.append(f"next run: {proposed.profile} ({proposed.why})")
    return lines


def parameter_texts(effect: EffectFinding) -> list[str]:
    """Each parameter of an effect with its 95 % interval, and its unit if it has one."""
    texts = []
    for name, p in effect.parameters.items():
        interval = f" [{p.ci95[0]:.4g}, {p.ci95[1]:.4g}]" if p.ci95 else ""
        unit = "" if p.unit == "1" else f" {p.unit}"
        texts.append(f"{name} {p.value:.4g}{interval}{unit}")
    return texts
