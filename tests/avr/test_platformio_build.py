"""PlatformIO's ELF is CMake's: the options of its link, and byte for byte what is built; where
PlatformIO is installed with the same compiler, its own ELF as well.
"""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from builds import BUILDS
from platformio_build import ROOT, build_elf, commands

ENVIRONMENTS = {"uno": "uno_elf", "uno_drill": "drill_elf", "mega": "mega_elf"}
# Without effect on code: constants, the map file, PlatformIO's default plugin, objects of LTO.
WITHOUT_CODE = {"-DF_CPU=16000000UL", "-DNDEBUG", "-fuse-linker-plugin", "-fno-fat-lto-objects"}
HASH_BYTES = 6  # three operands of the commit's hash, which the builds take at different times


def link_of_cmake(folder: str) -> set[str]:
    """Options of the link of an ELF of `make build`."""
    ninja = (ROOT / "build" / folder / "build.ninja").read_text()
    edge = re.search(r"^build [^:\n]*vgroove\.elf[^:\n]*:.*?\n\n", ninja, re.MULTILINE | re.DOTALL)
    flags = re.search(r"  LINK_FLAGS = (.*)", edge[0])[1].split()
    return {flag for flag in flags if not flag.startswith("-Wl,-Map")} - WITHOUT_CODE


def image(elf: Path) -> bytes:
    """Code and initial values as they are flashed."""
    target = elf.with_suffix(f".{os.getpid()}.bin")
    subprocess.run(
        ["avr-objcopy", "-O", "binary", "-R", ".eeprom", str(elf), str(target)], check=True
    )
    data = target.read_bytes()
    target.unlink()
    return data


def unequal_bytes(a: bytes, b: bytes) -> int:
    """Number of bytes that differ, of images of equal length."""
    assert len(a) == len(b)
    return sum(x != y for x, y in zip(a, b, strict=True))


@pytest.mark.parametrize("environment", ENVIRONMENTS)
def test_the_linker_gets_the_options_of_cmake(environment: str, tmp_path: Path) -> None:
    link = set(commands(environment, tmp_path).link) - WITHOUT_CODE
    assert link == link_of_cmake(BUILDS[ENVIRONMENTS[environment]].folder)


@pytest.mark.parametrize("environment", ["uno", "mega"])
def test_what_is_built_is_equal(
    environment: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    elf = request.getfixturevalue(ENVIRONMENTS[environment])
    built = build_elf(environment, tmp_path, elf.parent / "firmware" / "generated" / "build_hash.h")
    assert unequal_bytes(image(built), image(elf)) == 0


def version(compiler: str | Path) -> str:
    """Version of an avr-gcc, empty where it cannot be run."""
    try:
        return subprocess.run(
            [str(compiler), "-dumpversion"], capture_output=True, text=True, check=True
        ).stdout
    except (OSError, subprocess.CalledProcessError):
        return ""


def same_compiler() -> bool:
    """Whether PlatformIO is installed, and its avr-gcc is of the version that CMake uses: another
    one makes other code.
    """
    core = Path(os.environ.get("PLATFORMIO_CORE_DIR", Path.home() / ".platformio"))
    own = version(core / "packages" / "toolchain-atmelavr" / "bin" / "avr-gcc")
    return bool(shutil.which("pio")) and bool(own) and own == version("avr-gcc")


@pytest.mark.skipif(not same_compiler(), reason="no PlatformIO with CMake's version of avr-gcc")
def test_the_elf_of_platformio_is_equal(tmp_path: Path, uno_elf: Path) -> None:
    subprocess.run(
        ["pio", "run", "-e", "uno", "-d", str(ROOT)],
        check=True,
        env={**os.environ, "PLATFORMIO_BUILD_DIR": str(tmp_path)},
    )
    built = image(tmp_path / "uno" / "firmware.elf")
    assert unequal_bytes(built, image(uno_elf)) <= HASH_BYTES
