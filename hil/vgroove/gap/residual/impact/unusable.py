"""What makes a hammering tool's log, or a column of it, unusable although it has enough impacts."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import scipy.ndimage

from vgroove.errors import VgrooveError
from vgroove.gap.cleaning.sensor_noise import noise_of
from vgroove.gap.residual.clean_log import CleanLog
from vgroove.gap.residual.impact.cycle_statistics import REFERENCES, CycleReader, is_periodic
from vgroove.gap.residual.impact.cycle_windows import CycleWindows

FIXED = "locked"  # the kind of joint whose head does not turn


def refuse_begun_hammering(
    log: CleanLog, windows: CycleWindows, command: np.ndarray, rests: bool
) -> None:
    """VgrooveError for a log that begins while the tool hammers. command: (rows,); rests: whether
    the log shows that the shaft rests in its first row.
    """
    hammers = command[0] != 0.0 and windows.periodic[0] and not rests
    if hammers and log.rig.load["kind"] != FIXED:
        raise VgrooveError(
            f"{log.source}: the first rows show a tool that hammers already; how far the joint is "
            "tightened there is not known. Begin the log (and --from) before the trigger is pulled"
        )


def warn_of_sparse(log: CleanLog, names: Iterable[str], incomplete: np.ndarray) -> None:
    """Warn of each judged column in which more than half of the windows lack samples. names: of the
    S columns; incomplete (S, W): whether each window of each column lacks samples.
    """
    for name, windows in zip(names, incomplete, strict=True):
        if 2 * np.count_nonzero(windows) > len(windows):
            log.warn(
                f"{name}: {np.count_nonzero(windows)} of {len(windows)} windows lack samples for "
                "more than an eighth of a cycle in a row; they are not judged"
            )


def without_failed_speed(
    log: CleanLog, reader: CycleReader, values: dict[str, np.ndarray]
) -> CleanLog:
    """The log with the rows in which the speed stays 0 through a window in which another column
    shows blows taken as missing, with a warning: the shaft turns between blows. The same log where
    there are none.
    """
    speed, others = values.get("speed_rpm"), set(REFERENCES) & set(values) - {"speed_rpm"}
    if speed is None or not others:
        return log
    windows = reader.windows
    dead = (windows.cut(speed) == 0.0).all(axis=1)
    if dead.any():
        fit = reader.fit({name: column[None] for name, column in values.items()})
        hammers = [is_periodic(fit, reader.columns.index(name), windows) for name in others]
        dead &= np.logical_or.reduce(hammers)
    if not dead.any():
        return log
    first = windows.first[np.argmax(dead)]
    zeros, _ = scipy.ndimage.label(speed == 0.0)
    failed = np.isin(zeros, zeros[windows.first[dead]])
    columns = log.columns | {"speed_rpm": np.where(failed, np.nan, log.columns["speed_rpm"])}
    known = replace(
        log,
        columns=columns,
        noise=noise_of(log.rig, log.time_s, columns),
        log=replace(log.log, columns=columns),
    )
    known.warn(
        f"speed_rpm reads 0 in {np.count_nonzero(dead)} of {windows.count} windows, first at "
        f"{log.time_s[first]:.4g} s, while the tool hammers: it is taken as missing there"
    )
    return known
