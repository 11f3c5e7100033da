"""Lint the firmware: clang-tidy with --target=avr, cppcheck --platform=avr8 with MISRA, clang-format, golden vectors, page of pins."""

import concurrent.futures
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware"
AVR_INCLUDE = Path("/usr/lib/avr/include")
SUPPRESSIONS = Path(__file__).with_name("misra_suppressions.txt")
GENERATED = {"telemetry_signals.c"}


def sources(*rooms: str) -> list[Path]:
    """C files of rooms of firmware/, generated ones left out."""
    return [p for room in rooms for p in sorted((FIRMWARE / room).rglob("*.c")) if p.name not in GENERATED]


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


def tidy(path: Path) -> list[str]:
    """Findings of clang-tidy in one file, as the AVR sees it."""
    flags = ["--target=avr", "-mmcu=atmega328p", "-D__AVR_ATmega328P__", "-std=c11", f"-I{FIRMWARE}", "-isystem", str(AVR_INCLUDE),
             "-DF_CPU=16000000UL"]
    code, text = run(["clang-tidy", f"--config-file={ROOT}/.clang-tidy", "--quiet", str(path), "--", *flags])
    return [line for line in text.splitlines() if re.search(r": (warning|error): ", line)] if code else []


def cppcheck(paths: list[Path]) -> list[str]:
    """Findings of cppcheck and its MISRA addon, deviations left out."""
    off = [f"--suppress=misra-c2012-{rule}" for rule in suppressed_rules()]
    command = ["cppcheck", "--platform=avr8", "--std=c11", "--enable=warning,performance,portability", "--addon=misra",
               "--inline-suppr", "--quiet", f"-I{FIRMWARE}", "-j", "2", "--suppress=missingIncludeSystem", "--suppress=misra-config", *off,
               "--template={file}:{line}: {id}: {message}", *map(str, paths)]
    return [line for line in run(command)[1].splitlines() if re.match(r".+:\d+: ", line)]


def generated_pages() -> list[str]:
    """Generated files that are not what their source says."""
    scripts = ["firmware/hal/avr/pins.py", "tests/vectors/make_vectors.py"]
    return [text.strip() for script in scripts for code, text in [run([sys.executable, script, "--check"])] if code]


def findings() -> list[str]:
    """All findings, one a line."""
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        from_tidy = list(pool.map(tidy, portable()))
    return [line for lines in from_tidy for line in lines] + cppcheck(portable()) + generated_pages()


if __name__ == "__main__":
    found = findings()
    sys.stdout.write("\n".join(found) + ("\n" if found else ""))
    raise SystemExit(1 if found else 0)
