"""A case of the blind set with its answer and its verdict, and whether the verdict is right."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from vgroove.gap.catalogue import BY_ID, contains

# The value of an effect's leading parameter at a size of the generator (tests/truth/effects.py);
# for the other effects the parameter is the size.
VALUE_OF_SIZE = {
    "magnetic_saturation": lambda size: size**-0.5,
    "coupler_compliance": lambda size: 1.0 / size,
    "current_saturation": lambda size: 1.0 / size,
}


# Verdicts that name effects without rivals; `partial`: a significant remainder stays beside them
NAMING = ("effect", "partial")
# Outcomes that are right where no effect of the catalogue acts: by the label of the answer
UNNAMED = {"none": ("none",), "unlisted": ("unlisted",), "disturbances": ("none", "unlisted")}


@dataclass(frozen=True)
class ScoringLimits:
    """Limits of the scoring: the definitions of docs/gap_bench.md."""

    sure: float = 0.9  # least probability of a name that counts as sure
    power: float = 0.95  # share of cases that must be named from a size on
    close: float = 0.05  # relative error up to which a parameter counts as found


LIMITS = ScoringLimits()


def leading_parameter(effect_id: str) -> str:
    """Name of the parameter that stands for an effect's size."""
    return BY_ID[effect_id].leading.name


@dataclass(frozen=True)
class Scored:
    """A case with its opened answer, its verdict and the cost of the diagnosis.

    `without` is the effect that the catalogue lacked, or None.
    """

    number: int
    name: str
    without: str | None
    answer: dict[str, Any]
    verdict: dict[str, Any]
    seconds: float
    cpu_seconds: float
    memory_mib: float

    @property
    def kind(self) -> str:
        """single, pair, triple, none, unlisted or disturbances."""
        return self.answer["kind"]

    @property
    def outcome(self) -> str:
        """The verdict: effect, partial, ambiguous, none, unlisted or failed."""
        return self.verdict["verdict"]

    @property
    def selected(self) -> list[str]:
        """Ids of the selected effects, the likeliest first."""
        return self.verdict["selected"] or []

    @property
    def named(self) -> set[str]:
        """Ids of the selected effects and of their rivals."""
        return {r["id"] for r in self.verdict["indistinguishable"] or []} | set(self.selected)

    @property
    def tied(self) -> bool:
        """Whether other effects explain this log as well as the true ones."""
        return bool(self.answer.get("ties"))

    def true_name(self, name: str) -> bool:
        """Whether an id is a true effect or an accepted equivalent."""
        return any(name in ids for ids in self.answer["accept"])

    @property
    def complete(self) -> bool:
        """Whether the verdict names exactly the true effects, or is one that is right where there
        are none.
        """
        if self.answer["label"] != "effect":
            return self.outcome in UNNAMED[self.answer["label"]]
        return self.all_named and len(self.selected) == len(self.answer["accept"])

    @property
    def all_named(self) -> bool:
        """Whether the verdict has no rivals and names all true effects, perhaps with others."""
        return self.outcome in NAMING and all(
            set(ids) & set(self.selected) for ids in self.answer["accept"]
        )

    @property
    def names_something(self) -> bool:
        """Whether the verdict names an effect, with or without rivals."""
        return self.outcome in (*NAMING, "ambiguous")

    @property
    def ambiguous_tie(self) -> bool:
        """Whether the verdict is ambiguous, the case is tied, and the true effects are named."""
        return (
            self.outcome == "ambiguous"
            and self.tied
            and all(set(ids) & self.named for ids in self.answer["accept"])
        )

    @property
    def simpler_tie(self) -> bool:
        """Whether the verdict names special cases of the truth that are tied with it: of equal
        explanations the one with fewer parameters is selected (docs/spec/gap.md, section 5).
        """
        ids = tuple(self.answer["ids"])
        simpler = (
            tie
            for tie in self.answer.get("ties") or []
            if len(tie) == len(ids) and contains(ids, tuple(tie))
        )
        return self.outcome in NAMING and any(set(tie) == set(self.selected) for tie in simpler)

    @property
    def right_by_tie(self) -> bool:
        """Whether the verdict is the best that a tied case allows."""
        return self.ambiguous_tie or self.simpler_tie

    @property
    def leads(self) -> bool:
        """Whether the first selected effect is true."""
        return bool(self.selected) and self.true_name(self.selected[0])

    @property
    def first(self) -> bool:
        """Whether the first selected effect is true and the verdict has no rivals."""
        if self.answer["label"] != "effect":
            return self.complete
        return self.outcome in NAMING and self.leads

    @property
    def listed_first(self) -> bool:
        """Whether the first selected effect is true, rivals or not."""
        return self.first or self.outcome == "ambiguous" and self.leads

    @property
    def right(self) -> bool:
        """Whether the verdict is right by the goals: singles by their first effect, pairs and
        triples by all effects and no other; ties as right_by_tie.
        """
        return self.right_by_tie or (self.first if self.kind == "single" else self.complete)

    @property
    def probabilities(self) -> dict[str, float]:
        """Probability of each selected effect."""
        return {
            e["id"]: e["probability"]
            for e in self.verdict["effects"] or []
            if e["id"] in self.selected
        }

    @property
    def sure_and_wrong(self) -> bool:
        """Whether a verdict without rivals gives a wrong effect a probability of LIMITS.sure or
        more.
        """
        return self.outcome in NAMING and any(
            p >= LIMITS.sure and not self.true_name(i) for i, p in self.probabilities.items()
        )


@dataclass(frozen=True)
class WithoutEffect:
    """A case whose effect the catalogue lacked."""

    case: Scored

    @property
    def wrong(self) -> bool:
        """Whether the verdict is wrong: none, failed, or the name of an effect that is not
        equivalent to the removed one.
        """
        c = self.case
        return (
            c.outcome not in ("unlisted", "ambiguous")
            and any(not c.true_name(i) for i in c.selected)
            or c.outcome in ("none", "failed")
        )


def true_parameter(answer: dict[str, Any], effect_id: str) -> float:
    """True value of an effect's leading parameter. A delayed speed column holds its samples from
    row to row, so that its delay is a whole number of rows.
    """
    size = VALUE_OF_SIZE.get(effect_id, float)(answer["sizes"][effect_id])
    return (
        float(np.ceil(size * answer["log_hz"]) / answer["log_hz"])
        if "speed_delay_s" in answer["truth"]
        else size
    )
