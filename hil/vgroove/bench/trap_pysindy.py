"""PySINDy's sparse regression of the acceleration that the nominal joint does not explain, on the
log of `vgroove bench trap`.
"""

import time
import warnings

import numpy as np
import pysindy
from scipy.signal import savgol_filter

from vgroove.bench import trap
from vgroove.bench.trap import Answer, Floats, Motion

WINDOW, ORDER = 31, 3  # Savitzky-Golay filter of the measured speed
THRESHOLD = 1.0  # rad/s2 for a unit of a term: terms with a smaller coefficient are dropped
STEPS_PER_ROW = 20  # of the open-loop run
TERMS = (("w", lambda w: w), ("sign(w)", lambda w: np.sign(w)), ("w |w|", lambda w: w * np.abs(w)))


def answers(train: Motion, new: Motion) -> list[Answer]:
    """The terms of the regression, as damping and friction."""
    start = time.process_time()
    terms = residual_terms(train)
    busy = time.process_time() - start
    text = " ".join(f"{value:+.3g} {name}" for name, value in terms.items() if value) or "nothing"
    damping = trap.ASSUMED_DAMPING - trap.INERTIA * terms["w"]
    friction = -trap.INERTIA * terms["sign(w)"]
    error = trap.relative_error(free_run(terms, new), new)
    return [
        Answer(
            "PySINDy residual",
            f"acceleration lacks {text} rad/s2",
            damping,
            friction or None,
            error,
            busy,
        )
    ]


def residual_terms(train: Motion) -> dict[str, float]:
    """Coefficients of the terms in the acceleration that the nominal joint does not explain,
    rad/s2.
    """
    speed = savgol_filter(train.speed_rad_s, WINDOW, ORDER)
    rate = savgol_filter(train.speed_rad_s, WINDOW, ORDER, deriv=1, delta=1.0 / trap.LOG_HZ)
    torque = savgol_filter(train.torque_nm, WINDOW, ORDER)
    residual = rate - (torque - trap.ASSUMED_DAMPING * speed) / trap.INERTIA
    library = pysindy.CustomLibrary(
        [f for _, f in TERMS], [lambda x, n=name: n for name, _ in TERMS]
    )
    model = pysindy.SINDy(feature_library=library, optimizer=pysindy.STLSQ(threshold=THRESHOLD))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(speed[:, None], t=train.time_s, x_dot=residual[:, None])
    return dict(zip((name for name, _ in TERMS), model.coefficients()[0].tolist(), strict=True))


def free_run(terms: dict[str, float], new: Motion) -> Floats:
    """Speed (n,) in rad/s of the nominal joint with the terms, from rest; friction that would
    reverse the speed within a step holds the joint at rest.
    """
    step, speed = 1.0 / trap.LOG_HZ / STEPS_PER_ROW, 0.0
    out = np.empty(len(new.time_s))
    for row, torque in enumerate(new.torque_nm.tolist()):
        for _ in range(STEPS_PER_ROW):
            smooth = terms["w"] * speed + terms["w |w|"] * speed * abs(speed)
            free = speed + step * ((torque - trap.ASSUMED_DAMPING * speed) / trap.INERTIA + smooth)
            friction = -step * terms["sign(w)"]
            speed = free - np.copysign(friction, free) if abs(free) > friction else 0.0
        out[row] = speed
    return out
