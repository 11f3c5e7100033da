"""The built firmware with another torque map, as ELF and as hex file."""

import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from vgroove.errors import VgrooveError

SYMBOL = "torque_map"  # firmware/controllers/torque_map.h


def adapted_image(elf: Path, torque_map: bytes, kind: str) -> bytes:
    """Content of an ELF file ("elf") or of an Intel hex file ("hex") of the firmware `elf` with
    `torque_map` in place of its map; VgrooveError where `elf` has no map of this size.
    """
    old = map_in_flash(elf)
    if len(old) != len(torque_map):
        raise VgrooveError(
            f"the torque map of {elf} has {len(old)} bytes, not {len(torque_map)}: build it from "
            "the same version as vgroove with `make build`"
        )
    content = elf.read_bytes()
    if content.count(old) != 1:
        raise VgrooveError(f"{elf} does not hold its torque map exactly once: build it again")
    content = content.replace(old, torque_map)
    return content if kind == "elf" else _hex(content)


def map_in_flash(elf: Path) -> bytes:
    """The torque map that a firmware holds; VgrooveError for a firmware without torque control."""
    if not elf.is_file():
        raise VgrooveError(f"there is no firmware at {elf}: build it with `make build`")
    for line in _run("avr-nm", "-S", str(elf)).decode().splitlines():
        words = line.split()
        if len(words) == 4 and words[3] == SYMBOL:
            address, size = int(words[0], 16), int(words[1], 16)
            with TemporaryDirectory() as folder:
                flash = Path(folder) / "flash.bin"
                _run("avr-objcopy", "-O", "binary", "-R", ".eeprom", str(elf), str(flash))
                return flash.read_bytes()[address : address + size]
    raise VgrooveError(
        f"{elf} has no torque map: it is a firmware without torque control (a drill driver's), or "
        "older than `vgroove adapt`"
    )


def _hex(elf: bytes) -> bytes:
    """The hex file of an ELF, made as the build does (firmware/avr.cmake)."""
    with TemporaryDirectory() as folder:
        source, made = Path(folder) / "vgroove.elf", Path(folder) / "vgroove.hex"
        source.write_bytes(elf)
        removed = [word for section in (".eeprom", ".fuse", ".lock") for word in ("-R", section)]
        _run("avr-objcopy", "-O", "ihex", *removed, str(source), str(made))
        return made.read_bytes()


def _run(program: str, *arguments: str) -> bytes:
    """What a program of the AVR binutils prints; VgrooveError where it is missing or fails."""
    if shutil.which(program) is None:
        raise VgrooveError(f"{program} is missing: run `make setup`")
    done = subprocess.run([program, *arguments], capture_output=True, check=False)
    if done.returncode != 0:
        raise VgrooveError(f"{program}: {done.stderr.decode(errors='replace').strip()}")
    return done.stdout
