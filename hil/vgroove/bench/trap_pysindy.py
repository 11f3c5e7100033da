"""PySINDy's sparse regression of what the nominal joint leaves of the acceleration, on the trap's
log.
"""

import time
import warnings

import numpy as np
import pysindy
from scipy.signal import savgol_filter

from vgroove.bench import trap
from vgroove.bench.trap import Answer, Floats, Motion

WINDOW, ORDER = 31, 3  # Savitzky-Golay filter of the measured speed
THRESHOLD = 1.0  # rad/s2 a unit of term: smaller ones are dropped
TERMS = (("w", lambda w: w), ("sign(w)", lambda w: np.sign(w)), ("w |w|", lambda w: w * np.abs(w)))


def answers(seen: Motion, new: Motion) -> list[Answer]:
    """The regression's terms, read as damping and friction."""
    start = time.process_time()
    terms = residual_terms(seen)
    busy = time.process_time() - start
    says = " ".join(f"{value:+.3g} {name}" for name, value in terms.items() if value) or "nothing"
    damping = trap.BELIEVED_DAMPING - trap.INERTIA * terms["w"]
    friction = -trap.INERTIA * terms["sign(w)"]
    error = trap.relative_error(free_run(terms, new), new)
    return [
        Answer(
            "PySINDy residual",
            f"acceleration lacks {says} rad/s2",
            damping,
            friction or None,
            error,
            busy,
        )
    ]


def residual_terms(seen: Motion) -> dict[str, float]:
    """Coefficients of the terms in the acceleration that the nominal joint does not explain,
    rad/s2.
    """
    speed = savgol_filter(seen.speed_rad_s, WINDOW, ORDER)
    rate = savgol_filter(seen.speed_rad_s, WINDOW, ORDER, deriv=1, delta=1.0 / trap.LOG_HZ)
    torque = savgol_filter(seen.torque_nm, WINDOW, ORDER)
    residual = rate - (torque - trap.BELIEVED_DAMPING * speed) / trap.INERTIA
    library = pysindy.CustomLibrary(
        [f for _, f in TERMS], [lambda x, n=name: n for name, _ in TERMS]
    )
    model = pysindy.SINDy(feature_library=library, optimizer=pysindy.STLSQ(threshold=THRESHOLD))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(speed[:, None], t=seen.time_s, x_dot=residual[:, None])
    return dict(zip((name for name, _ in TERMS), model.coefficients()[0].tolist(), strict=True))


def free_run(terms: dict[str, float], new: Motion) -> Floats:
    """Speed (n,) rad/s of the nominal joint with the terms, from rest; a sign that would turn the
    speed round holds it.
    """
    step, speed = 1.0 / trap.LOG_HZ / 20, 0.0
    out = np.empty(len(new.time_s))
    for row, torque in enumerate(new.torque_nm.tolist()):
        for _ in range(20):
            smooth = terms["w"] * speed + terms["w |w|"] * speed * abs(speed)
            free = speed + step * ((torque - trap.BELIEVED_DAMPING * speed) / trap.INERTIA + smooth)
            friction = -step * terms["sign(w)"]
            speed = free - np.copysign(friction, free) if abs(free) > friction else 0.0
        out[row] = speed
    return out
