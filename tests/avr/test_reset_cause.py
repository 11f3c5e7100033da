"""The reset cause in BOOT: from MCUSR, or from r2 when a boot loader has cleared MCUSR."""

from pathlib import Path

import pytest
from builds import BUILDS
from equality import sent_bytes
from test_power_cut import inputs

from vgroove import board, telemetry

POWER_ON, BROWN_OUT, WATCHDOG = 1, 4, 8  # bits of MCUSR
PERIODS = 6000  # 0.2 s


def reported(elf: Path, mcu: str, **options: object) -> int:
    """reset_cause of the first BOOT frame."""
    sent = sent_bytes(board.replay(elf, inputs(PERIODS), mcu=mcu, **options))
    boots = [frame for frame in telemetry.Framer().feed(sent) if frame.id == telemetry.BOOT]
    return telemetry.decode_integers(boots[0])["reset_cause"]


@pytest.mark.parametrize("name", BUILDS)
@pytest.mark.parametrize("cause", [POWER_ON, BROWN_OUT, WATCHDOG])
def test_a_cause_in_r2_is_reported(name: str, cause: int, request: pytest.FixtureRequest) -> None:
    elf = request.getfixturevalue(name)
    assert reported(elf, BUILDS[name].mcu, boot_r2=cause) == cause


@pytest.mark.parametrize("value", [0, 16, 0xC5])
def test_another_value_of_r2_is_no_cause(value: int, uno_elf: Path) -> None:
    assert reported(uno_elf, "atmega328p", boot_r2=value) == 0


def test_without_a_boot_loader_it_is_mcusr(uno_elf: Path) -> None:
    assert reported(uno_elf, "atmega328p", reset_cause="wdt") == WATCHDOG
