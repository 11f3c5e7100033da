"""One reported parameter of an effect."""

from dataclasses import dataclass


@dataclass(frozen=True)
class ParameterEstimate:
    """Fitted value in `unit`, and its 95 % interval; None where the value was not fitted."""

    value: float
    ci95: tuple[float, float] | None
    unit: str
