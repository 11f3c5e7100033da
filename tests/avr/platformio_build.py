"""PlatformIO's build of the firmware without its downloads: platformio.ini and its scripts are
evaluated with a substitute of the SCons environment that follows PlatformIO 6 (builder/main.py,
tools/piobuild.py) and the bare framework of its platform atmelavr (builder/frameworks/_bare.py).
"""

import configparser
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
FIRMWARE = ROOT / "firmware"
MCUS = {"uno": "atmega328p", "megaatmega2560": "atmega2560"}  # of PlatformIO's boards
BARE_COMPILE = ["-Os", "-Wall", "-ffunction-sections", "-fdata-sections", "-flto"]
BARE_LINK = ["-Os", "-Wl,--gc-sections", "-flto", "-fuse-linker-plugin"]


@dataclass(frozen=True)
class Node:
    """A source file as SCons gives it to a build middleware."""

    path: Path

    def get_path(self) -> str:
        """Path of the file."""
        return str(self.path)


@dataclass(frozen=True)
class Compilation:
    """A source file and the options it is compiled with."""

    source: Path
    options: tuple[str, ...]


@dataclass
class Environment:
    """The calls of a SCons environment that the project's scripts use."""

    values: dict[str, Any]
    middlewares: list[Callable[..., Any]] = field(default_factory=list)

    def __getitem__(self, name: str) -> Any:
        return self.values[name]

    def Append(self, **lists: list[str]) -> None:  # noqa: N802  SCons' name
        """Append to lists of options."""
        for name, items in lists.items():
            self.values.setdefault(name, []).extend(items)

    def AddBuildMiddleware(  # noqa: N802  PlatformIO's name
        self, callback: Callable[..., Any], pattern: str
    ) -> None:
        """Note a function that each source is passed to."""
        assert pattern == "*.c"
        self.middlewares.append(callback)

    def Object(self, node: Node, CCFLAGS: list[str]) -> Compilation:  # noqa: N802, N803
        """The compilation of a source with other options."""
        return Compilation(node.path, tuple(CCFLAGS))

    def subst(self, text: str) -> str:
        """A text with its $VARIABLE replaced."""
        return re.sub(r"\$(\w+)", lambda match: str(self.values[match[1]]), text)


@dataclass(frozen=True)
class Commands:
    """Compilations in the order of the link, and the options of the link."""

    mcu: str
    compilations: tuple[Compilation, ...]
    link: tuple[str, ...]


def _parsed(flags: list[str]) -> dict[str, list[str]]:
    """Options by SCons variable: those that begin with -Wl are the linker's alone."""
    linker = [flag for flag in flags if flag.startswith("-Wl,")]
    return {"LINKFLAGS": linker, "CCFLAGS": [flag for flag in flags if flag not in linker]}


def _unflagged(flags: list[str], removed: list[str]) -> list[str]:
    return [flag for flag in flags if flag not in removed]


def _own_or_common(
    own: configparser.SectionProxy, common: configparser.SectionProxy, name: str
) -> list[str]:
    """The value of the key `name` of an environment as a list of options. Its own value may contain
    ${env.NAME}, the value that is common to all environments; without its own it has that.
    """
    return own.get(name, common[name]).replace(f"${{env.{name}}}", common[name]).split()


def commands(environment: str, build: Path) -> Commands:
    """Commands of an environment of platformio.ini, with `build` as its build folder."""
    parser = configparser.ConfigParser(interpolation=None)
    parser.read_string((ROOT / "platformio.ini").read_text())
    common, own = parser["env"], parser[f"env:{environment}"]
    flags = _own_or_common(own, common, "build_flags")
    mcu = f"-mmcu={MCUS[own['board']]}"
    env = Environment(
        {
            "PROJECT_DIR": ROOT,
            "BUILD_DIR": build,
            "BUILD_FLAGS": [" ".join(flags)],
            "CPPPATH": [],
        }
    )
    for script in re.findall(r"pre:(\S+)", common["extra_scripts"]):
        path = ROOT / script
        exec(  # noqa: S102  as SCons does
            compile(path.read_text(), str(path), "exec"), {"Import": lambda _: None, "env": env}
        )
    parsed, removed = _parsed(flags), _own_or_common(own, common, "build_unflags")
    clock = f"-DF_CPU={common['board_build.f_cpu']}"
    env.Append(CCFLAGS=[*BARE_COMPILE, mcu, clock, *parsed["CCFLAGS"]])
    env.Append(LINKFLAGS=[*BARE_LINK, mcu, *parsed["LINKFLAGS"]])
    env.values["CCFLAGS"] = _unflagged(env["CCFLAGS"], removed) + [f"-I{p}" for p in env["CPPPATH"]]
    compilations = tuple(_compilation(env, source) for source in _sources(common))
    return Commands(mcu, compilations, tuple(_unflagged(env["LINKFLAGS"], removed)))


def _sources(common: configparser.SectionProxy) -> list[Path]:
    """The files that build_src_filter selects, sorted by path as PlatformIO does."""
    patterns = re.findall(r"\+<([^>]*)>", common["build_src_filter"])
    names = (p + "**/*.c" if p.endswith("/") else p for p in patterns)
    found = {path for name in names for path in FIRMWARE.glob(name)}
    return sorted(found, key=lambda path: path.relative_to(FIRMWARE).as_posix())


def _compilation(env: Environment, source: Path) -> Compilation:
    node: Any = Node(source)
    for middleware in env.middlewares:
        node = middleware(env, node)
    return node if isinstance(node, Compilation) else Compilation(source, tuple(env["CCFLAGS"]))


def build_elf(environment: str, folder: Path, hash_header: Path) -> Path:
    """The ELF of an environment, built in a folder with the installed avr-gcc and the commit's hash
    of another build.
    """
    todo, objects = commands(environment, folder), []
    shutil.copy(hash_header, folder / "generated" / "build_hash.h")
    for number, one in enumerate(todo.compilations):
        objects.append(str(folder / f"{number:02}.o"))
        subprocess.run(
            ["avr-gcc", *one.options, "-c", str(one.source), "-o", objects[-1]],
            check=True,
            cwd=ROOT,
        )
    elf = folder / "firmware.elf"
    subprocess.run(
        ["avr-gcc", "-o", str(elf), *todo.link, *objects, "-Wl,--start-group", "-lm"]
        + ["-Wl,--end-group"],
        check=True,
        cwd=ROOT,
    )
    return elf
