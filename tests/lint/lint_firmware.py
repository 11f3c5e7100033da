"""Lint the firmware: clang-tidy with --target=avr, cppcheck --platform=avr8 with MISRA, golden
vectors, page of pins.
"""

import atexit
import concurrent.futures
import functools
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware"
AVR_INCLUDE = Path("/usr/lib/avr/include")
# cppcheck of hal/avr: it takes ISR() for one function of many definitions (8.6), and its vector for
# an unused parameter (2.7).
BOARD = ("-D__AVR_ATmega328P__", "--suppress=misra-c2012-2.7", "--suppress=misra-c2012-8.6")
SUPPRESSIONS = Path(__file__).with_name("misra_suppressions.txt")
GENERATED = {"telemetry_signals.c"}


def sources(*folders: str) -> list[Path]:
    """C files of folders of firmware/, generated ones left out."""
    return [
        p
        for folder in folders
        for p in sorted((FIRMWARE / folder).rglob("*.c"))
        if p.name not in GENERATED
    ]


def portable() -> list[Path]:
    return sources("core", "drivers", "controllers", "telemetry", "app")


def run(command: list[str]) -> tuple[int, str]:
    """Return code and output of a command in the root of the repository."""
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def suppressed_rules() -> list[str]:
    """Rules of misra_suppressions.txt; a line without a reason is an error."""
    rules = []
    for line in SUPPRESSIONS.read_text(encoding="utf-8").splitlines():
        if line.strip() and not line.startswith("#"):
            match = re.fullmatch(r"(\d+\.\d+): \S.*", line)
            if not match:
                raise SystemExit(f"{SUPPRESSIONS.name}: no reason given: {line}")
            rules.append(match.group(1))
    return rules


def board_sources() -> list[Path]:
    return sources("hal/avr")


def host_sources() -> list[Path]:
    """What only the host builds: the simulated machine and the fake one of the unit tests."""
    return sources("hal/sim", "hal/native")


@functools.cache
def stand_ins() -> Path:
    """A folder with build_hash.h, which the build makes, and declarations for the inline assembly
    of avr-libc that clang does not take.
    """
    folder = Path(tempfile.mkdtemp(prefix="vgroove-lint-"))
    atexit.register(shutil.rmtree, folder)
    (folder / "avr").mkdir()
    (folder / "build_hash.h").write_text("#define VGROOVE_BUILD_HASH 0u\n", encoding="ascii")
    watchdog = (
        "#define WDTO_15MS 0\nvoid wdt_enable(unsigned char value);\n"
        "void wdt_disable(void);\nvoid wdt_reset(void);\n"
    )
    (folder / "avr/wdt.h").write_text(watchdog, encoding="ascii")
    return folder


def tidy(path: Path) -> list[str]:
    """Findings of clang-tidy in one file, as the AVR sees it, or the host where only the host
    builds it.
    """
    flags = ["-std=c11", f"-I{FIRMWARE}", "-isystem", str(stand_ins())]
    if path not in host_sources():
        # clang takes no C statements in naked functions; avr-gcc does, and theirs touch no stack.
        flags += [
            "--target=avr",
            "-mmcu=atmega328p",
            "-D__AVR_ATmega328P__",
            "-DF_CPU=16000000UL",
            "-Dnaked=used",
            "-isystem",
            str(AVR_INCLUDE),
        ]
    code, text = run(
        ["clang-tidy", f"--config-file={ROOT}/.clang-tidy", "--quiet", str(path), "--", *flags]
    )
    found = (
        [line for line in text.splitlines() if re.search(r": (warning|error): ", line)]
        if code
        else []
    )
    return found if found or not code else [f"{path}: clang-tidy ended with {code}: {text.strip()}"]


def cppcheck(paths: list[Path], *more: str, platform: str = "avr8") -> list[str]:
    """Findings of cppcheck and, for the target, its MISRA addon, deviations left out."""
    rules = ["--addon=misra"] if platform == "avr8" else []
    off = [f"--suppress=misra-c2012-{rule}" for rule in suppressed_rules()]
    command = [
        "cppcheck",
        f"--platform={platform}",
        "--std=c11",
        "--enable=warning,performance,portability",
        *rules,
        "--inline-suppr",
        "--quiet",
        f"-I{FIRMWARE}",
        f"-I{stand_ins()}",
        "-j",
        "2",
        "--suppress=missingIncludeSystem",
        "--suppress=misra-config",
        *off,
        *more,
        "--template={file}:{line}: {id}: {message}",
        *map(str, paths),
    ]
    return [line for line in run(command)[1].splitlines() if re.match(r".+:\d+: ", line)]


def generated_pages() -> list[str]:
    """Generated files that are not what their source says."""
    scripts = ["firmware/hal/avr/pins.py", "tests/vectors/make_vectors.py"]
    return [
        text.strip()
        for script in scripts
        for code, text in [run([sys.executable, script, "--check"])]
        if code
    ]


def findings() -> list[str]:
    """All findings, one a line."""
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        from_tidy = list(pool.map(tidy, portable() + board_sources() + host_sources()))
    from_cppcheck = (
        cppcheck(portable())
        + cppcheck(board_sources(), *BOARD)
        + cppcheck(host_sources(), platform="unix64")
    )
    return [line for lines in from_tidy for line in lines] + from_cppcheck + generated_pages()


if __name__ == "__main__":
    found = findings()
    sys.stdout.write("\n".join(found) + ("\n" if found else ""))
    raise SystemExit(1 if found else 0)
