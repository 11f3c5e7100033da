"""Figures of the controllers' pages, drawn by `vgroove bench figures docs/images`."""

from collections.abc import Callable, Sequence
from pathlib import Path

from vgroove.chromium import find_chromium, svg_of
from vgroove.control_bench import (
    blows_page,
    drill_page,
    screwing_page,
    sync_page,
    torque_page,
    vibration_page,
)
from vgroove.control_bench.waves import Wave, wave_picture
from vgroove.output import check_outputs, write_text

WAVES: dict[str, Callable[[], Wave]] = {
    "blows": blows_page.wave,
    "sync": sync_page.wave,
    "screwing": screwing_page.wave,
    "vibration": vibration_page.wave,
    "torque": torque_page.wave,
    "drill": drill_page.wave,
}


def image_path(folder: Path, wave: Wave) -> Path:
    """The figure's file."""
    return folder / f"control_{wave.name}.svg"


def write_figures(parts: Sequence[str], folder: Path) -> list[Path]:
    """Draw one figure a part into an existing folder; returns the paths."""
    waves = [WAVES[part]() for part in parts]
    paths = [image_path(folder, wave) for wave in waves]
    check_outputs(paths)
    chromium = find_chromium()
    for wave, path in zip(waves, paths, strict=True):
        write_text(path, svg_of(chromium, wave_picture(wave).figure))
    return paths
