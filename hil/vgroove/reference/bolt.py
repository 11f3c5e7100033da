"""The bolt of the tightening studies: M16, VDI 2230 part 1; lengths in m."""

PITCH_M, FLANK_M, HEAD_M = 2e-3, 14.701e-3, 20e-3  # docs/spec/model.md, section 6
FRICTIONS = (0.10, 0.12, 0.14)  # least, middle and largest coefficient of thread and head


def lever_m(friction: float) -> float:
    """Tightening torque over preload, N m/N: 0.16 P + 0.58 d2 mu + D_Km mu / 2 (VDI 2230)."""
    return 0.16 * PITCH_M + (0.58 * FLANK_M + 0.5 * HEAD_M) * friction
