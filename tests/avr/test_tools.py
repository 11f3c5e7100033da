"""A build has the controllers of its tool alone: it refuses the modes of the other one, selects the
plain mode in their place, and a build that exceeds the flash is refused with a sentence.
"""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from builds import BUILDS
from equality import sent_bytes

from vgroove import board, telemetry
from vgroove.board import BoardInputs, pack_inputs
from vgroove.eeprom_image import eeprom_image, mode_number

ROOT = Path(__file__).resolve().parents[2]
REST = BoardInputs((512, 740, 102, 154))  # ADC counts: 0 A, 18.5 V, trigger released, 25 degC
SWITCH_AT_1 = 4  # bit of HAL_SWITCH_*
MODES = ("duty", "sync", "screwing", "vibration", "torque", "drill")
OK, OUT_OF_RANGE = "ok", "out_of_range"
FIRST, GAP, REST_PERIODS = 9000, 2000, 31372  # PWM periods, 31,372 in a second


def index_of(name: str) -> int:
    return [parameter.name for parameter in telemetry.parameter_list()].index(name)


def commands() -> list[bytes]:
    """SET_MODE of every mode, then PARAM_WRITE of every mode to the four parameters of modes."""
    frames = [
        telemetry.frame_of_signals("SET_MODE", 0, mode_request=mode_number(mode), mode_sequence=k)
        for k, mode in enumerate(MODES)
    ]
    for name in ("mode", "mode_switch_1", "mode_switch_2", "mode_switch_3"):
        frames += [
            telemetry.frame_of_signals(
                "PARAM_WRITE",
                0,
                write_index=index_of(name),
                write_value=mode_number(mode),
                write_sequence=len(frames) + k,
            )
            for k, mode in enumerate(MODES)
        ]
    return [telemetry.frame_bytes(frame) for frame in frames]


def tape(frames: list[bytes], switches: int = 0) -> bytes:
    """Packed inputs of a board at rest that receives the frames."""
    messages = [pack_inputs(REST._replace(switches=switches))] * (
        FIRST + GAP * len(frames) + REST_PERIODS
    )
    for number, frame in enumerate(frames):
        for k, byte in enumerate(frame):
            messages[FIRST + GAP * number + 2 * k] = pack_inputs(
                REST._replace(rx=bytes([byte]), switches=switches)
            )
    return b"".join(messages)


def frames_of(elf: Path, mcu: str, messages: bytes, **options: object) -> list[telemetry.Frame]:
    return telemetry.Framer().feed(sent_bytes(board.replay(elf, messages, mcu=mcu, **options)))


def last_mode(frames: list[telemetry.Frame]) -> int:
    return [telemetry.decode(frame) for frame in frames if frame.id == telemetry.STATE][-1]["mode"]


@pytest.mark.parametrize("name", BUILDS)
def test_the_modes_of_the_other_tool_are_refused(name: str, request: pytest.FixtureRequest) -> None:
    build, frames = BUILDS[name], commands()
    sent = frames_of(request.getfixturevalue(name), build.mcu, tape(frames))
    results = telemetry.value_table("ACK", "ack_result")
    acks = [telemetry.decode_integers(frame) for frame in sent if frame.id == telemetry.ACK]
    found = [results[ack["ack_result"]] for ack in acks]
    expected = [OK if build.has(mode) else OUT_OF_RANGE for mode in MODES]
    assert found == expected * (len(frames) // len(MODES))


@pytest.mark.parametrize("name", BUILDS)
@pytest.mark.parametrize("mode", ["sync", "drill"])
def test_a_stored_mode_of_the_other_tool_selects_the_plain_mode(
    mode: str, name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    """At start from the parameter `mode`, and at position 1 of the mode switch."""
    build, memory = BUILDS[name], tmp_path / "eeprom.bin"
    stored = {"mode": mode_number(mode), "mode_switch_1": mode_number(mode)}
    for switches in (0, SWITCH_AT_1):
        memory.write_bytes(eeprom_image(stored))
        sent = frames_of(
            request.getfixturevalue(name), build.mcu, tape([], switches), eeprom=memory
        )
        assert last_mode(sent) == mode_number(mode if build.has(mode) else "duty")


def test_a_run_says_which_mode_the_firmware_lacks(drill_elf: Path, tmp_path: Path) -> None:
    text = (ROOT / "scenarios" / "spin_up.toml").read_text().replace("../rigs", str(ROOT / "rigs"))
    scenario = tmp_path / "sync.toml"
    scenario.write_text(
        re.sub(r"duration_s = .*", "duration_s = 0.8", text)
        + '\n[[command]]\ntime_s = 0.25\nframe = "SET_MODE"\nmode_request = 1\n'
    )
    done = subprocess.run(
        [
            *(sys.executable, "-m", "vgroove.cli", "run", str(scenario)),
            *("--on", "avr", "--elf", str(drill_elf)),
        ],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "the board has no mode sync: its firmware holds the controllers of another tool" in (
        done.stderr
    )


def configure(folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [
            *("cmake", "-S", str(ROOT), "-B", str(folder), "-G", "Ninja"),
            *("--toolchain", str(ROOT / "cmake" / "avr-gcc.cmake")),
            *("-DCMAKE_BUILD_TYPE=MinSizeRel", *options),
        ],
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_build_beyond_the_flash_is_refused_with_a_sentence(tmp_path: Path) -> None:
    options = ("-DVGROOVE_TOOL=both", "-DVGROOVE_FLASH_LIMIT=20000")
    assert configure(tmp_path, *options).returncode == 0
    built = subprocess.run(
        ["cmake", "--build", str(tmp_path), "-j", "1"], capture_output=True, text=True, check=False
    )
    assert built.returncode != 0
    said = " ".join((built.stdout + built.stderr).split())
    assert "VGROOVE_TOOL=both takes" in said and "20000 are allowed" in said
    assert "choose VGROOVE_TOOL=impact or drill" in said


def test_an_unknown_tool_is_refused_with_a_sentence(tmp_path: Path) -> None:
    configured = configure(tmp_path, "-DVGROOVE_TOOL=saw")
    assert configured.returncode != 0
    assert 'VGROOVE_TOOL is impact, drill or both, not "saw"' in configured.stderr
