"""Frames on the serial line: 19 bytes with id, board time, seven signal bytes and a CRC-8."""

import struct
from typing import TYPE_CHECKING, NamedTuple

from vgroove.errors import VgrooveError
from vgroove.telemetry.signals import database

if TYPE_CHECKING:
    import can

FRAME_BYTES = 19
START, END, LENGTH = 0xAA, 0xBB, 8
CRC8_POLYNOMIAL = 0x2F  # AUTOSAR CRC8H2F; initial value and final inversion 0xFF
CRC16_POLYNOMIAL = 0x1021


def _crc8_table() -> bytes:
    table = bytearray()
    for byte in range(256):
        for _ in range(8):
            byte = ((byte << 1) ^ CRC8_POLYNOMIAL if byte & 0x80 else byte << 1) & 0xFF
        table.append(byte)
    return bytes(table)


_CRC8 = _crc8_table()


def crc8(data: bytes) -> int:
    """AUTOSAR CRC8H2F: polynomial 0x2F, initial value 0xFF, inverted at the end."""
    crc = 0xFF
    for byte in data:
        crc = _CRC8[crc ^ byte]
    return crc ^ 0xFF


def crc16(data: bytes) -> int:
    """CRC-16 with polynomial 0x1021 and initial value 0xFFFF."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ CRC16_POLYNOMIAL if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


class Frame(NamedTuple):
    """An intact frame: board time in ms (modulo 2^32), id, 8 data bytes of which the last is the
    CRC.
    """

    time_ms: int
    id: int
    data: bytes

    def message(self) -> "can.Message":
        """The frame as python-can's serial bus would deliver it."""
        import can

        return can.Message(
            timestamp=self.time_ms / 1000,
            arbitration_id=self.id,
            is_extended_id=False,
            data=self.data,
        )


def frame_crc(time_ms: int, frame_id: int, payload: bytes) -> int:
    """CRC-8 of a frame over id, time and data[0..6]."""
    return crc8(struct.pack("<II", frame_id, time_ms) + payload[:7])


def frame_of(time_ms: int, frame_id: int, payload: bytes) -> Frame:
    """A frame with its CRC added; `payload`: the first 7 data bytes."""
    return Frame(time_ms, frame_id, payload[:7] + bytes([frame_crc(time_ms, frame_id, payload)]))


def frame_of_signals(name: str, time_ms: int, **signals: float) -> Frame:
    """A frame from physical values of its signals; the others are 0 or their minimum above 0, the
    CRC is computed. VgrooveError for a signal that the frame has not.
    """
    message = database().get_message_by_name(name)
    values = {
        signal.name: signals.pop(signal.name, 0 if (signal.minimum or 0) <= 0 else signal.minimum)
        for signal in message.signals
    }
    if signals:
        raise VgrooveError(f"The frame {name} has no signal {', '.join(sorted(signals))}.")
    return frame_of(time_ms, message.frame_id, message.encode(values))


def frame_bytes(frame: Frame) -> bytes:
    """The frame on the wire, in python-can's serial format."""
    return struct.pack("<BIBI", START, frame.time_ms, LENGTH, frame.id) + frame.data + bytes([END])


def frame_from_message(message: "can.Message") -> Frame | None:
    """A frame read by python-can; None where its kind, length or CRC is wrong."""
    time_ms = round(message.timestamp * 1000) & 0xFFFFFFFF
    frame = Frame(time_ms, message.arbitration_id, bytes(message.data))
    if message.is_extended_id or message.is_error_frame or message.is_remote_frame:
        return None
    intact = len(frame.data) == LENGTH and frame_crc(*frame) == frame.data[7]
    return frame if intact else None
