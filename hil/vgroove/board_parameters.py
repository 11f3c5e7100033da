"""Writes parameters into a board's EEPROM over its serial port."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import can
import serial

from vgroove import telemetry
from vgroove.eeprom_image import parameter
from vgroove.errors import VgrooveError
from vgroove.serial_bus import ResyncBus, open_bus

RATES_BD = (250_000, 115_200)  # of a board, by its parameter baud_select
ANSWER_S = 0.5  # longest wait for an ACK
TRIES = (
    4  # of a command whose answer is lost; the board answers a repeated one without executing it
)
START_S = 3.0  # a board whose opened port resets it is silent for so long at most
SAVE_S = 3.0  # longest wait until the set is in the EEPROM
WRITE_ID = telemetry.database().get_message_by_name("PARAM_WRITE").frame_id
SAVING = "param_saving"  # of STATE.flags


class _Writer:
    """Parameters on their way to a board."""

    def __init__(self, bus: ResyncBus, port: str) -> None:
        self.bus, self.port = bus, port

    def wait_for_board(self) -> None:
        """Wait for a frame; VgrooveError when none comes."""
        if self._until(lambda frame: True, START_S) is None:
            raise VgrooveError(f"{self.port}: no frame of a vgroove board within {START_S:g} s")

    def write(self, name: str, raw: int, index: int, sequence: int) -> None:
        """Write one parameter; VgrooveError where the board refuses it or does not answer."""
        # another time in each frame: the board takes one of equal sequence and CRC for a repetition
        now_ms = time.monotonic_ns() // 1_000_000 & 0xFFFFFFFF
        frame = telemetry.frame_of_signals(
            "PARAM_WRITE", now_ms, write_index=index, write_value=raw, write_sequence=sequence
        )
        for _ in range(TRIES):
            self.bus.write(telemetry.frame_bytes(frame))
            answer = self._until(lambda f: _answers(f, sequence), ANSWER_S)
            if answer is not None:
                break
        else:
            raise VgrooveError(f"{self.port}: the board does not answer; {name} was not written")
        result = telemetry.value_table("ACK", "ack_result")[
            telemetry.decode_integers(answer)["ack_result"]
        ]
        if result == "not_now":
            raise VgrooveError(
                f"{self.port}: the tool is driven: release the trigger and repeat; {name} and the "
                "parameters after it were not written"
            )
        if result != "ok":
            raise VgrooveError(f"{self.port}: the board refuses {name} = {raw}: {result}")

    def wait_until_saved(self) -> None:
        """Wait until the board has saved the set; VgrooveError when it does not end."""
        time.sleep(0.1)  # the state that reports the save comes at least every 50 ms
        if self._until(lambda frame: _at_rest(frame), SAVE_S) is None:
            raise VgrooveError(f"{self.port}: the board did not report that the set is saved")

    def _until(
        self, matches: Callable[[telemetry.Frame], bool], seconds: float
    ) -> telemetry.Frame | None:
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            for frame in self.bus.read_frames():
                if matches(frame):
                    return frame
        return None


def _answers(frame: telemetry.Frame, sequence: int) -> bool:
    if frame.id != telemetry.ACK:
        return False
    ack = telemetry.decode_integers(frame)
    return ack["ack_command"] == WRITE_ID and ack["ack_sequence"] == sequence


def _at_rest(frame: telemetry.Frame) -> bool:
    if frame.id != telemetry.STATE:
        return False
    flags = telemetry.value_table("STATE", "flags")
    saving = next(bit for bit, name in flags.items() if name == SAVING)
    return not telemetry.decode_integers(frame)["flags"] & saving


@contextmanager
def _board_at(port: str, baud: int) -> Iterator[_Writer]:
    """The writer to the board at a port. VgrooveError for a rate that no board has, a port that
    cannot be opened or is lost, and where no board sends.
    """
    if baud not in RATES_BD:
        rates = " or ".join(map(str, RATES_BD))
        raise VgrooveError(f"--baud is {rates}, the rates of a board, not {baud}")
    try:
        with open_bus(port, baud) as bus:
            writer = _Writer(bus, port)
            writer.wait_for_board()
            yield writer
    except (can.CanError, serial.SerialException, OSError) as error:
        raise VgrooveError(f"{port}: the port cannot be used: {error}") from error


def check_board(port: str, baud: int) -> None:
    """VgrooveError where no parameters could be written to a board at the port."""
    with _board_at(port, baud):
        pass


def write_parameters(port: str, values: Mapping[str, float], baud: int = 250_000) -> None:
    """Write physical values by parameter name, in their order, and wait until they are in the
    EEPROM. VgrooveError names the first parameter that was not written.
    """
    names = [entry.name for entry in telemetry.parameter_list()]
    with _board_at(port, baud) as writer:
        for sequence, (name, value) in enumerate(values.items(), start=1):
            entry = parameter(name)
            raw = round(value * 2**entry.q)
            writer.write(entry.name, raw, names.index(entry.name), sequence)
        writer.wait_until_saved()
