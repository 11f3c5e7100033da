"""Limits of the ELFs: flash, static RAM, no floating point at run time. Prints the figures; exit
code 1 when a limit is exceeded.
"""

import re
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FLASH_LIMIT = 28 * 1024  # of the ATmega328P's 32 KiB
MEGA_FLASH_LIMIT = 60 * 1024  # of the ATmega2560's 256 KiB: tables are read by 16-bit addresses
# Builds for real-time runs: no reserve of flash, since they are flashed for the bench alone.
HIL_FLASH_LIMIT = 30 * 1024
RAM_LIMIT = int(1.5 * 1024)
TICK_CYCLES_MAX = 5000  # of 16,000, including the interrupts within the tick
CONTROL_CYCLES_MAX = 1500
FOLDERS = ("avr-uno", "avr-uno-drill", "avr-mega", "avr-uno-hil", "avr-uno-drill-hil")
ELFS = [f"build/{name}/vgroove.elf" for name in FOLDERS]
SOFT_FLOAT = re.compile(
    r"__(add|sub|mul|div|cmp|eq|ne|lt|le|gt|ge|fix|fixuns|float|floatun|neg|fp_)"
    r"[a-z]*(sf|df|si)?[23]?$"
)
FLOAT_MARK = re.compile(r"sf|df|fp_")


@dataclass(frozen=True)
class Budget:
    """Bytes of flash and static RAM of one ELF, and the names of its float routines."""

    flash: int
    ram: int
    soft_float: tuple[str, ...]
    flash_limit: int = FLASH_LIMIT

    def broken(self) -> list[str]:
        """A sentence for each exceeded limit."""
        over = self.flash > self.flash_limit
        out = [f"flash {self.flash} > {self.flash_limit} bytes"] if over else []
        out += [f"static RAM {self.ram} > {RAM_LIMIT} bytes"] if self.ram > RAM_LIMIT else []
        return out + (
            [f"soft-float routines: {', '.join(self.soft_float)}"] if self.soft_float else []
        )


def tool(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def soft_float(symbols: list[str]) -> tuple[str, ...]:
    """Names of libgcc's and avr-libc's float routines among `symbols`."""
    return tuple(sorted(s for s in symbols if SOFT_FLOAT.match(s) and FLOAT_MARK.search(s)))


def flash_limit(folder: str) -> int:
    """Bytes of flash that the ELF of a build folder may take."""
    if "mega" in folder:
        return MEGA_FLASH_LIMIT
    return HIL_FLASH_LIMIT if folder.endswith("-hil") else FLASH_LIMIT


def measure(elf: Path) -> Budget:
    """Sizes by section: .text and .data are in flash; .data, .bss and .noinit in RAM."""
    sections = {
        m[1]: int(m[2])
        for m in re.finditer(r"^(\.\w+)\s+(\d+)", tool("avr-size", "-A", str(elf)), re.MULTILINE)
    }
    symbols = [line.split()[-1] for line in tool("avr-nm", str(elf)).splitlines() if line.strip()]
    flash = sections.get(".text", 0) + sections.get(".data", 0)
    return Budget(
        flash,
        sum(sections.get(name, 0) for name in (".data", ".bss", ".noinit")),
        soft_float(symbols),
        flash_limit(elf.parent.name),
    )


def main() -> int:
    broken = []
    for name in sys.argv[1:] or ELFS:
        budget = measure(ROOT / name)
        sys.stdout.write(
            f"{name}: flash {budget.flash} of {budget.flash_limit}, "
            f"static RAM {budget.ram} of {RAM_LIMIT} bytes\n"
        )
        broken += [f"{name}: {sentence}" for sentence in budget.broken()]
    sys.stdout.write("".join(f"{line}\n" for line in broken))
    return 1 if broken else 0


if __name__ == "__main__":
    raise SystemExit(main())
