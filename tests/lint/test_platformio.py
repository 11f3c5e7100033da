"""platformio.ini builds what CMake builds: the same sources, flags, warnings and clock, and the
same files for speed.
"""

import configparser
import json
import re
from pathlib import Path

import pytest
import rules

FIRMWARE = rules.ROOT / "firmware"
# CMake says these by target_include_directories and CMAKE_C_STANDARD
NOT_OF_CMAKE = {"-Ifirmware", "-std=c11"}
NOT_OF_PLATFORMIO = {"-mmcu=${VGROOVE_MCU}", "-DF_CPU=16000000UL"}  # its boards' own
BOARDS = {"uno": "uno", "uno_drill": "uno", "mega": "megaatmega2560"}  # ATmega328P and ATmega2560
TOOLS = {name: f"-DVGROOVE_TOOL={n}" for name, n in {"uno": 1, "uno_drill": 2, "mega": 3}.items()}


def ini(text: str | None = None) -> configparser.ConfigParser:
    parser = configparser.ConfigParser(interpolation=None)
    parser.read_string(text or (rules.ROOT / "platformio.ini").read_text())
    return parser


def flags_of_platformio(parser: configparser.ConfigParser, name: str) -> set[str]:
    """Compiler options of an environment of platformio.ini, except those that the source of
    flags_of_cmake does not state: NOT_OF_CMAKE, and the one that selects the tool.
    """
    own, common = parser[f"env:{name}"]["build_flags"], parser["env"]["build_flags"]
    flags = set(own.replace("${env.build_flags}", common).split())
    return flags - NOT_OF_CMAKE - {TOOLS[name]}


def flags_of_cmake(board: str) -> set[str]:
    """Compiler options that CMake gives for one of BOARDS, except NOT_OF_PLATFORMIO."""
    avr, root = (FIRMWARE / "avr.cmake").read_text(), (rules.ROOT / "CMakeLists.txt").read_text()
    levels = re.search(
        r'if\(VGROOVE_MCU STREQUAL "atmega2560"\).*\n\s*set\(optimisation ([^)]*)\)'
        r"\nelse\(\)\n\s*set\(optimisation ([^)]*)\)",
        avr,
    )
    flags = set(re.search(r"set\(avr_flags ([^)]*)\)", avr)[1].split()) - {"${optimisation}"}
    flags |= set(levels[1 if board == "megaatmega2560" else 2].split())
    flags |= set(re.findall(r"-Wl,--(?:gc-sections|sort-section=alignment)", avr))
    warnings = re.search(
        r"target_compile_options\(vgroove_warnings INTERFACE(.*?)\)\n", root, re.DOTALL
    )[1]
    return (flags | set(re.findall(r"-W[a-z][\w-]*", warnings))) - NOT_OF_PLATFORMIO


def sources_of_cmake(build: int = 0) -> set[str]:
    """C files of the firmware; a list of CMake within the list is that of a file(GLOB). `build`: 0
    the tool's, 1 the one for real-time runs.
    """
    cmake = (FIRMWARE / "CMakeLists.txt").read_text()
    listed = re.search(r"set\(firmware_sources(.*?)\)", cmake, re.DOTALL)[1].split()
    avr = re.findall(
        r"set\(target_sources \$\{firmware_sources\}([^)]*)\)",
        (FIRMWARE / "avr.cmake").read_text(),
    )[build].split()
    found = {name for name in (*listed, *avr) if not name.startswith("$")}
    for name in (name[2:-1] for name in listed if name.startswith("$")):
        pattern = re.search(rf"file\(GLOB {name}\b[^)]*?(\S+\.c)\)", cmake)[1]
        found |= {path.relative_to(FIRMWARE).as_posix() for path in FIRMWARE.glob(pattern)}
    return found


def sources_of_platformio(
    parser: configparser.ConfigParser, root: Path = FIRMWARE, section: str = "env"
) -> set[str]:
    """C files that build_src_filter selects, as PlatformIO reads it: +<folder/> or +<pattern>."""
    patterns = re.findall(r"\+<([^>]*)>", parser[section]["build_src_filter"])
    found = (
        path
        for pattern in patterns
        for path in root.glob(pattern + "**/*.c" if pattern.endswith("/") else pattern)
    )
    return {path.relative_to(root).as_posix() for path in found}


@pytest.mark.parametrize("name", BOARDS)
def test_flags_are_those_of_cmake(name: str) -> None:
    assert flags_of_platformio(ini(), name) == flags_of_cmake(BOARDS[name])


def test_sources_are_those_of_cmake() -> None:
    assert sources_of_platformio(ini()) == sources_of_cmake()


def test_builds_for_real_time_runs_have_the_sources_of_cmake() -> None:
    parser = ini()
    assert sources_of_platformio(parser, section="hil") == sources_of_cmake(1)
    for name, board in BOARDS.items():
        section = parser[f"env:{name}_hil"]
        assert section["board"] == board
        assert section["build_src_filter"] == "${hil.build_src_filter}"
        for key in ("build_flags", "build_unflags"):
            assert section.get(key) == parser[f"env:{name}"].get(key)


def test_clock_boards_and_rates() -> None:
    parser = ini()
    assert parser["env"]["board_build.f_cpu"] == "16000000L"
    assert {name: parser[f"env:{name}"]["board"] for name in BOARDS} == BOARDS
    assert parser["env"]["monitor_speed"] == "250000"
    assert not any(
        option.startswith("framework")
        for section in parser.sections()
        for option in parser[section]
    ), "bare AVR"


def test_tools_are_those_of_the_presets() -> None:
    presets = json.loads((rules.ROOT / "CMakePresets.json").read_text())["configurePresets"]
    tools = {
        preset["name"]: preset["cacheVariables"].get("VGROOVE_TOOL") for preset in presets[-3:]
    }
    assert tools == {"avr-uno": None, "avr-uno-drill": "drill", "avr-mega": None}
    parser = ini()
    for name, tool in TOOLS.items():
        common, *level, last = parser[f"env:{name}"]["build_flags"].split()
        assert (common, last) == ("${env.build_flags}", tool)
        assert level[0].startswith("-O") and all(flag.startswith("-f") for flag in level[1:])


def test_the_files_for_speed_come_from_cmake() -> None:
    scripts = re.findall(r"pre:(\S+)", ini()["env"]["extra_scripts"])
    assert all((rules.ROOT / script).is_file() for script in scripts)
    assert "firmware/hal/avr/platformio_speed.py" in scripts
    pattern = re.search(
        r're\.findall\(\s*r"(.*?)",\s*cmake\s*\)',
        (FIRMWARE / "hal/avr/platformio_speed.py").read_text(),
    )[1]
    listed = {
        option: set(names.split())
        for names, option in re.findall(pattern, (FIRMWARE / "avr.cmake").read_text())
    }
    assert listed.keys() == {"-O2", "-fno-inline-small-functions"}
    assert "hal/avr/isr.c" in listed["-O2"] and set.union(*listed.values()) <= sources_of_cmake()


def test_a_difference_is_seen() -> None:
    text = (rules.ROOT / "platformio.ini").read_text()
    for name, board in BOARDS.items():
        for old, new in (("-Wshadow ", ""), ("-Os", "-O2"), ("-O3", "-O2")):
            changed = old in flags_of_cmake(board) or old.endswith(" ")
            found = flags_of_platformio(ini(text.replace(old, new)), name)
            assert (found != flags_of_cmake(board)) == changed
    assert sources_of_platformio(ini(text.replace("+<drivers/> ", ""))) != sources_of_cmake()
