"""A simulated Optiboot bootloader: the STK500v1 protocol (Atmel application note AVR061) on a pty,
with the flash memory of an ATmega328P.
"""

import os
import select
import threading
import tty

SIGNATURE = bytes([0x1E, 0x95, 0x0F])
FLASH_BYTES = 32768
IN_SYNC, NO_SYNC, OK, END_OF_PACKET = 0x14, 0x15, 0x10, 0x20
# commands of AVR061 that avrdude sends to Optiboot
GET_PARAMETER, SET_DEVICE, SET_DEVICE_EXT, LEAVE = 0x41, 0x42, 0x45, 0x51
LOAD_ADDRESS, UNIVERSAL, PROGRAM_PAGE, READ_PAGE, READ_SIGNATURE = 0x55, 0x56, 0x64, 0x74, 0x75
ARGUMENT_BYTES = {
    GET_PARAMETER: 1,
    SET_DEVICE: 20,
    SET_DEVICE_EXT: 5,
    LOAD_ADDRESS: 2,
    UNIVERSAL: 4,
    READ_PAGE: 3,
}
VERSIONS = {0x81: 8, 0x82: 0}  # major and minor; Optiboot answers other parameters with 3


class Bootloader:
    """Answers on the pty `name` until closed; a context manager. `corrupt_at` is a flash address
    whose bit 0 is written wrong.
    """

    def __init__(self, corrupt_at: int | None = None) -> None:
        self._master, slave = os.openpty()
        tty.setraw(slave)
        self._slave = slave  # open, so that the pty exists while no reader has it open
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
        if command == PROGRAM_PAGE:
            head = self._read(3)
            body = head + self._read(head[0] << 8 | head[1])
        else:
            body = self._read(ARGUMENT_BYTES.get(command, 0))
        if self._read(1)[0] != END_OF_PACKET:
            os.write(self._master, bytes([NO_SYNC]))
            return
        os.write(self._master, bytes([IN_SYNC]) + self._result(command, body) + bytes([OK]))

    def _result(self, command: int, body: bytes) -> bytes:
        if command == GET_PARAMETER:
            return bytes([VERSIONS.get(body[0], 3)])
        if command == LEAVE:
            self.left_programming = True
        if command == LOAD_ADDRESS:
            self._address = 2 * (body[0] | body[1] << 8)
        if command == UNIVERSAL:
            return b"\0"
        if command == PROGRAM_PAGE:
            self._write(body[3:])
        if command == READ_PAGE:
            count = body[0] << 8 | body[1]
            return bytes(self.flash[self._address : self._address + count])
        return SIGNATURE if command == READ_SIGNATURE else b""

    def _write(self, page: bytes) -> None:
        self.flash[self._address : self._address + len(page)] = page
        written = range(self._address, self._address + len(page))
        if self.corrupt_at in written:
            self.flash[self.corrupt_at] ^= 1
