"""The catalogue as rows, for `vgroove effects` and for the tables of the pages."""

from typing import Any

from vgroove.errors import VgrooveError

from . import BY_ID, CATALOGUE, NEEDS, SUBSYSTEMS
from .entry import Effect, Parameter

SYMBOLS = (
    "symbols: T friction torque at the motor shaft, w and th speed and angle of the motor, d duty, "
    "i motor current, N gear ratio, TL load torque, t time; all: docs/spec/model.md"
)


def effect_rows() -> list[dict[str, Any]]:
    """One dictionary an effect: what `vgroove effects --json` prints."""
    return [_row(effect) for effect in CATALOGUE]


def _row(effect: Effect) -> dict[str, Any]:
    form = effect.form
    return {
        "id": effect.id,
        "subsystem": effect.subsystem,
        "equation": effect.equation,
        "remark": effect.remark,
        "parameters": [_parameter_row(p) for p in effect.own_parameters],
        "needs": [NEEDS[flag] for flag in effect.needs],
        "special_case_of": list(effect.special_case_of),
        "identical_to": [other for other, _ in effect.identical_to],
        "forms": {form.key: list(form.words)} if form else {},
        "repeats_with_the_angle": effect.has_phase,
        "loads": list(effect.loads),
    }


def _parameter_row(parameter: Parameter) -> dict[str, Any]:
    neutral = parameter.neutral if abs(parameter.neutral) != float("inf") else "infinite"
    return {
        "name": parameter.name,
        "unit": parameter.unit,
        "neutral": neutral,
        "accepts": parameter.key.words,
        "fitted_only": not parameter.reported,
    }


def markdown_table() -> str:
    """Table of docs/spec/gap.md, section 3: subsystem, id with its parameters, equation."""
    lines = ["| subsystem | id [parameters] | equation |", "| --- | --- | --- |"]
    for effect in CATALOGUE:
        names = ", ".join(p.name for p in effect.own_parameters if p.reported)
        law = f"{effect.equation}; {effect.remark}" if effect.remark else effect.equation
        lines.append(f"| {effect.subsystem} | `{effect.id}` [{names}] | {law} |")
    return "\n".join(lines)


def list_lines() -> list[str]:
    """All effects by subsystem, each with its equation, and then the symbols of the equations."""
    width = max(len(effect.id) for effect in CATALOGUE)
    lines = []
    for subsystem in SUBSYSTEMS:
        lines.append(subsystem)
        lines += [f"  {e.id:{width}}  {e.equation}" for e in CATALOGUE if e.subsystem == subsystem]
    return [*lines, SYMBOLS]


def effect_lines(effect_id: str) -> list[str]:
    """One effect in full; VgrooveError for an unknown id."""
    if effect_id not in BY_ID:
        raise VgrooveError(f"no effect {effect_id} in the catalogue; `vgroove effects` lists them")
    row = _row(BY_ID[effect_id])
    lines = [f"{row['id']} ({row['subsystem']})", f"  equation: {row['equation']}"]
    lines += [f"  remark: {row['remark']}"] if row["remark"] else []
    for p in row["parameters"]:
        part = ", fitted, not reported" if p["fitted_only"] else ""
        neutral = f"{p['neutral']}: effect absent{part}"
        lines.append(f"  {p['name']} [{p['unit']}]: {p['accepts']}; {neutral}")
    lines += [f"  {key}: {' or '.join(words)}" for key, words in row["forms"].items()]
    for title, names in (
        ("a log must hold", row["needs"]),
        ("special case of", row["special_case_of"]),
        ("not distinguishable from", row["identical_to"]),
        ("acts on loads", row["loads"]),
    ):
        lines += [f"  {title}: {', '.join(names)}"] if names else []
    return [*lines, f"  {SYMBOLS}"]
