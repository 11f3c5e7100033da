"""Figures of a run: clean blows, tightening work, vibration of the housing."""

from functools import cache
from typing import Any

import numpy as np
import scipy  # its parts load when they are first used

from vgroove.control_bench.runs import Run
from vgroove.reference.blows import BLOW, CLEAN, REPEAT, clean

HOUSING_HZ = 20_000.0  # sampling rate of the housing reaction
BAND_HZ = (6.0, 1250.0)  # the band of hand-arm vibration
BAND_ORDER = 4
ISO_HZ = {"f1": 6.310, "f2": 1258.9, "f3": 15.915, "f4": 15.915}  # ISO 5349-1:2001, table A.1
ISO_Q = {"q1": 0.71, "q2": 0.64}  # ISO 5349-1:2001, table A.1
MIN_HITS = 4  # with fewer a tool counts as not impacting
SETTLE_S = 0.05  # the filter of `ripple` starts from the mean over it
WORK_POINTS = 200  # of the integral of the tightening work


def sync_figures(run: Run, from_s: float, to_s: float | None = None) -> dict[str, Any]:
    """Share of clean blows, period spread, rate and tightening work per second, from from_s to
    to_s, by default the end of the run. A tool that does not impact has the clean share 0.
    """
    to_s = run.duration_s if to_s is None else to_s
    hits = run.hits[(run.hits["time_s"] >= from_s) & (run.hits["time_s"] <= to_s)]
    period = np.diff(hits["time_s"][hits["kind"] == BLOW])
    enough = len(hits) >= MIN_HITS and len(period) > 1
    height = run.rig.mechanism["lug_height_m"]
    return {
        "hits": len(hits),
        "clean": float(clean(hits, height).mean()) if enough else 0.0,
        "repeats": int((hits["kind"] == REPEAT).sum()),
        "skipped": int((hits["skipped"] > 0).sum()),
        "shallow": int((hits["engaged_m"] < CLEAN.engaged_share * height).sum()),
        "blows_per_min": float(60.0 / period.mean()) if enough else 0.0,
        "spread": float(period.std() / period.mean()) if enough else None,
        "work_w": tightening_work(run, from_s, to_s) / (to_s - from_s),
        "impulse_nm": float(hits["impulse_nm_s"].sum() / (to_s - from_s)),
        "faults": run.faults,
    }


def tightening_work(run: Run, from_s: float, to_s: float) -> float:
    """Work in J into a slipping joint: integral of the slip torque over the head's angle; 0 on a
    locked joint.
    """
    if run.rig.load["kind"] == "locked":
        return 0.0
    ends = np.interp([from_s, to_s], run.truth["time_s"], run.truth["head_rad"])
    angle_rad = np.linspace(*ends, WORK_POINTS)
    return float(np.trapezoid(run.slip_nm(angle_rad), angle_rad))


def housing_20k(run: Run) -> tuple[np.ndarray, np.ndarray]:
    """Times and housing reaction T_h in N m at 20 kHz, (n,) each, from the means over PWM periods.

    A sample is the mean over the 50 us that end at its time.
    """
    time_s, mean = run.truth["time_s"], run.truth["housing_nm"]
    edges = np.concatenate(([2 * time_s[0] - time_s[1]], time_s))
    momentum = np.concatenate(([0.0], np.cumsum(mean * np.diff(edges))))
    grid = np.arange(edges[0], edges[-1], 1.0 / HOUSING_HZ)
    return grid[1:], np.diff(np.interp(grid, edges, momentum)) * HOUSING_HZ


@cache
def band_filter() -> np.ndarray:
    """Butterworth band-pass of order 4, 6 to 1,250 Hz, at 20 kHz, as second-order sections."""
    return scipy.signal.butter(BAND_ORDER, BAND_HZ, "bandpass", fs=HOUSING_HZ, output="sos")


@cache
def hand_arm_filter() -> np.ndarray:
    """Weighting W_h of ISO 5349-1 (annex A) by the bilinear transform, at 20 kHz, as second-order
    sections.
    """
    w = {key: 2 * HOUSING_HZ * np.tan(np.pi * hz / HOUSING_HZ) for key, hz in ISO_HZ.items()}
    band = (
        [w["f2"] ** 2, 0.0, 0.0],
        np.polymul(
            [1.0, w["f1"] / ISO_Q["q1"], w["f1"] ** 2], [1.0, w["f2"] / ISO_Q["q1"], w["f2"] ** 2]
        ),
    )
    weight = (
        np.array([1.0, w["f3"]]) * w["f4"] ** 2 / w["f3"],
        [1.0, w["f4"] / ISO_Q["q2"], w["f4"] ** 2],
    )
    zeros, poles = np.polymul(band[0], weight[0]), np.polymul(band[1], weight[1])
    return scipy.signal.tf2sos(*scipy.signal.bilinear(zeros, poles, HOUSING_HZ))


def vibration(run: Run, from_s: float, to_s: float) -> dict[str, float]:
    """AC RMS of T_h in N m from from_s to to_s: in the band, and weighted by the hand-arm weighting
    of ISO 5349-1.
    """
    time_s, housing = housing_20k(run)
    inside = (time_s >= from_s) & (time_s <= to_s)
    return {
        name: rms(scipy.signal.sosfilt(sos, housing)[inside])
        for name, sos in (("rms_nm", band_filter()), ("weighted_nm", hand_arm_filter()))
    }


def ripple(run: Run, from_s: float, to_s: float) -> float:
    """AC RMS in N m of T_h in the band from from_s to to_s alone: the filter starts in the steady
    state of the mean over the first SETTLE_S.
    """
    time_s, housing = housing_20k(run)
    inside = housing[(time_s >= from_s) & (time_s <= to_s)]
    settled = scipy.signal.sosfilt_zi(band_filter()) * inside[: round(SETTLE_S * HOUSING_HZ)].mean()
    return rms(scipy.signal.sosfilt(band_filter(), inside, zi=settled)[0])


def rms(values: np.ndarray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
