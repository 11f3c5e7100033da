"""Lint the firmware: clang-tidy with --target=avr, cppcheck --platform=avr8 with MISRA, rules of
its structure, golden vectors, page of pins.
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
# cppcheck of hal/avr: it mistakes ISR() for one function with many definitions (8.6) and its vector
# for an unused parameter (2.7).
BOARD = ("-D__AVR_ATmega328P__", "--suppress=misra-c2012-2.7", "--suppress=misra-c2012-8.6")
SUPPRESSIONS = Path(__file__).with_name("misra_suppressions.txt")
GENERATED = {"telemetry_signals.c"}


def sources(*folders: str) -> list[Path]:
    """C files of folders of firmware/, without the generated ones."""
    return [
        p
        for folder in folders
        for p in sorted((FIRMWARE / folder).rglob("*.c"))
        if p.name not in GENERATED
    ]


def portable() -> list[Path]:
    """C files that both the target and the host build."""
    inject = [path for path in sources("hal/inject") if path not in board_sources()]
    return sources("core", "drivers", "controllers", "telemetry", "app") + inject


def run(command: list[str]) -> tuple[int, str]:
    """Return code and output of a command in the root of the repository."""
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def suppressed_rules() -> list[str]:
    """Rules of misra_suppressions.txt; exits with a message on a line without a reason."""
    rules = []
    for line in SUPPRESSIONS.read_text(encoding="utf-8").splitlines():
        if line.strip() and not line.startswith("#"):
            match = re.fullmatch(r"(\d+\.\d+): \S.*", line)
            if not match:
                raise SystemExit(f"{SUPPRESSIONS.name}: no reason given: {line}")
            rules.append(match.group(1))
    return rules


def board_sources() -> list[Path]:
    """C files that only the target builds."""
    return [*sources("hal/avr"), FIRMWARE / "hal/inject/avr_main.c"]


def host_sources() -> list[Path]:
    """C files that only the host builds: simulated hardware, fake hardware of the unit tests."""
    return sources("hal/host", "hal/sim", "hal/native", "hal/measured")


@functools.cache
def stand_ins() -> Path:
    """A folder with build_hash.h, which the build generates, and declarations that replace the
    inline assembly of avr-libc, which clang rejects.
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
    """Findings of clang-tidy in one file, compiled for the AVR, or for the host if only the host
    builds it.
    """
    flags = ["-std=c11", f"-I{FIRMWARE}", "-isystem", str(stand_ins())]
    if path not in host_sources():
        # clang rejects C statements in naked functions; those of hal/avr use no stack.
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
    """Findings of cppcheck and, for the target, of its MISRA addon, without the deviations."""
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
    """Generated files that do not match their source."""
    scripts = ["firmware/hal/avr/pins.py", "tests/vectors/make_vectors.py"]
    return [
        text.strip()
        for script in scripts
        for code, text in [run([sys.executable, script, "--check"])]
        if code
    ]


def code_of(text: str) -> str:
    """C source without comments and string literals; line numbers are kept."""
    pattern = re.compile(r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"', re.DOTALL)
    return pattern.sub(lambda match: re.sub(r"[^\n]", " ", match.group()), text)


def switch_defaults(path: str, text: str) -> list[str]:
    """`default:` labels: they hide a missing case from -Wswitch-enum."""
    return [
        f"{path}:{number}: default: in a switch; list all enumerators"
        for number, line in enumerate(code_of(text).splitlines(), 1)
        if re.search(r"\bdefault\s*:", line)
    ]


def listed_controllers(text: str) -> set[str]:
    """Names of the entries of CONTROL_LIST, in the spelling of the modes and of the functions."""
    entries = re.findall(r"^    X\((\w+), (\w+), (\w+),", text, re.MULTILINE)
    return {name for entry in entries for name in entry}


def named_controllers(path: str, text: str, names: set[str]) -> list[str]:
    """Identifiers of the dispatcher that contain the name of a controller or of its mode."""
    pattern = re.compile(r"\b(?:\w+_)?(?:" + "|".join(sorted(names)) + r")(?:Setpoints|_\w+)?\b")
    return [
        f"{path}:{number}: {match.group()} names a controller; use a column of CONTROL_LIST"
        for number, line in enumerate(code_of(text).splitlines(), 1)
        for match in pattern.finditer(line)
    ]


def include_cycles(modules: dict[str, set[str]]) -> list[str]:
    """Pairs of modules that include each other, directly or through others; `modules` maps each
    module to those it includes.
    """
    reach = {name: set(included) for name, included in modules.items()}
    for _ in modules:
        for name in modules:
            reach[name] |= {far for near in reach[name] for far in reach.get(near, set())}
    return [
        f"{a} and {b} include each other"
        for a in sorted(modules)
        for b in sorted(modules)
        if a < b and b in reach[a] and a in reach[b]
    ]


def modules_of_app() -> dict[str, set[str]]:
    """Modules of firmware/app (header and source together) -> modules of it that they include.
    app.h is left out: it declares the state that the others share.
    """
    modules: dict[str, set[str]] = {}
    for path in sorted((FIRMWARE / "app").glob("*.[ch]")):
        included = re.findall(r'#include "app/(\w+)\.h"', path.read_text(encoding="utf-8"))
        modules.setdefault(path.stem, set()).update(set(included) - {path.stem, "app"})
    return modules


def structure() -> list[str]:
    """Findings of the rules about switches, the dispatcher and includes."""
    texts = {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for folder in (FIRMWARE, ROOT / "hil" / "board")
        for ending in ("*.c", "*.h", "*.cpp", "*.hpp")
        for path in sorted(folder.rglob(ending))
    }
    names = listed_controllers(texts["firmware/app/control_list.h"])
    dispatcher = ("firmware/app/control.c", "firmware/app/control.h", "firmware/app/modes.c")
    found = [line for path, text in texts.items() for line in switch_defaults(path, text)]
    found += [line for path in dispatcher for line in named_controllers(path, texts[path], names)]
    return found + include_cycles(modules_of_app())


def findings() -> list[str]:
    """All findings, one per line."""
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        from_tidy = list(pool.map(tidy, portable() + board_sources() + host_sources()))
    from_cppcheck = (
        cppcheck(portable())
        + cppcheck(board_sources(), *BOARD)
        + cppcheck(host_sources(), platform="unix64")
    )
    from_tools = [line for lines in from_tidy for line in lines] + from_cppcheck
    return from_tools + structure() + generated_pages()


if __name__ == "__main__":
    found = findings()
    sys.stdout.write("\n".join(found) + ("\n" if found else ""))
    raise SystemExit(1 if found else 0)
