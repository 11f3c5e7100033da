"""Puts a diagnosis into words: one sentence, and the lines that a terminal shows."""


def spaced_name(name: str) -> str:
    """An identifier as people say it."""
    return name.replace("_", " ")


def verdict_sentence(verdict: dict) -> str:
    """The verdict in one sentence."""
    gap, names = verdict["gap"], " and ".join(spaced_name(n) for n in verdict["selected"])
    figures = f"gap {gap['before']:.2f} before, {gap['retuned']:.2f} retuned, {gap['after']:.2f} after (noise floor {gap['floor']:.2f})"
    if verdict["verdict"] == "none":
        return f"No gap beyond the noise and the stated tolerances: {figures}."
    if verdict["verdict"] == "unlisted":
        left = verdict["unexplained"]["best_correlate"]
        follows = f"; what remains follows {left}" if left else ""
        return f"A real gap that no effect of the catalogue closes: {figures}{follows}."
    if verdict["verdict"] == "ambiguous":
        others = ", ".join(spaced_name(r["id"]) for r in verdict["indistinguishable"])
        return f"Most likely {names}, but {others} would predict these logs as well: {figures}."
    return f"The missing effect is {names}: {figures}."


def summary_lines(verdict: dict) -> list[str]:
    """Lines for a terminal."""
    lines = [verdict_sentence(verdict)]
    shares = {k: v for k, v in verdict["where"]["share"].items() if v >= 0.005}
    if shares:
        lines.append(
            "where: "
            + ", ".join(
                f"{k} {100 * v:.0f} %" for k, v in sorted(shares.items(), key=lambda i: -i[1])
            )
        )
    for effect in [e for e in verdict["effects"] if e["id"] in verdict["selected"]]:
        lines.append(
            f"{effect['id']}: probability {effect['probability']:.2f}, "
            + ", ".join(parameter_texts(effect))
        )
    for other in verdict["indistinguishable"]:
        lines.append(f"not to be told from {other['instead_of']}: {other['id']}")
    if verdict["next_experiment"]:
        lines.append(
            f"next run: {verdict['next_experiment']['profile']} ({verdict['next_experiment']['why']})"
        )
    return lines


def parameter_texts(effect: dict) -> list[str]:
    """Each parameter with its interval and unit."""
    out = []
    for name, p in effect["parameters"].items():
        ci = f" [{p['ci95'][0]:.4g}, {p['ci95'][1]:.4g}]" if p["ci95"] else ""
        out.append(f"{name} {p['value']:.4g}{ci} {p['unit']}")
    return out
