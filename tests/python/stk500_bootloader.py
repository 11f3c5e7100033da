"""A simulated Optiboot: the STK500v1 protocol (Atmel AVR061) on a pty, with the flash of an
ATmega328P behind it.
"""

import os
import select
import threading
import tty

SIGNATURE = bytes([0x1E, 0x95, 0x0F])
FLASH_BYTES = 32768
IN_SYNC, OK, UNKNOWN, EOP = 0x14, 0x10, 0x12, 0x20


class Bootloader:
    """Answers on `name` until closed; `corrupt_at` is a flash address whose bit 0 does not take. A
    context manager.
    """

    def __init__(self, corrupt_at: int | None = None) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self._slave = slave  # kept open: the pty lives as long as the board
        self.name = os.ttyname(slave)
        self.flash = bytearray(b"\xff" * FLASH_BYTES)
        self.corrupt_at = corrupt_at
        self.left_programming = False
        self._address = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def __enter__(self) -> "Bootloader":
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(5)
        os.close(self._master)
        os.close(self._slave)

    def _read(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            if self._stop.is_set():
                raise EOFError
            if select.select([self._master], [], [], 0.05)[0]:
                data += os.read(self._master, count - len(data))
        return data

    def _serve(self) -> None:
        try:
            while True:
                self._answer(self._read(1)[0])
        except (EOFError, OSError):
            return

    def _answer(self, command: int) -> None:
        arguments = {0x41: 1, 0x42: 20, 0x45: 5, 0x55: 2, 0x56: 4, 0x74: 3}.get(command, 0)
        if command == 0x64:
            head = self._read(3)
            body = head + self._read(head[0] << 8 | head[1])
        else:
            body = self._read(arguments)
        if self._read(1)[0] != EOP:
            os.write(self._master, bytes([0x15]))  # no sync
            return
        os.write(self._master, bytes([IN_SYNC]) + self._result(command, body) + bytes([OK]))

    def _result(self, command: int, body: bytes) -> bytes:
        if command == 0x41:  # get parameter: versions, anything else 3 as Optiboot answers
            return bytes([{0x81: 8, 0x82: 0}.get(body[0], 3)])
        if command == 0x51:
            self.left_programming = True
        if command == 0x55:
            self._address = 2 * (body[0] | body[1] << 8)
        if command == 0x56:
            return b"\0"
        if command == 0x64:
            self._write(body[3:])
        if command == 0x74:
            count = body[0] << 8 | body[1]
            return bytes(self.flash[self._address : self._address + count])
        return SIGNATURE if command == 0x75 else b""

    def _write(self, page: bytes) -> None:
        self.flash[self._address : self._address + len(page)] = page
        if self.corrupt_at is not None and self._address <= self.corrupt_at < self._address + len(
            page
        ):
            self.flash[self.corrupt_at] ^= 1
