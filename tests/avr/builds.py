"""The firmware's builds: microcontroller and tool of each ELF, and the cases whose mode it has."""

from dataclasses import dataclass

from impact import CASES


@dataclass(frozen=True)
class Build:
    """An ELF of `make build`: microcontroller, number of the target in BOOT, name of the folder in
    build/, and the tools whose controllers it holds.
    """

    mcu: str
    target: int
    folder: str
    tools: tuple[str, ...]

    def has(self, mode: str) -> bool:
        """Whether a mode's controller is compiled in; the plain mode is in every build."""
        return mode == "duty" or ("drill" if mode == "drill" else "impact") in self.tools


BUILDS = {
    "uno_elf": Build("atmega328p", 1, "avr-uno", ("impact",)),
    "drill_elf": Build("atmega328p", 1, "avr-uno-drill", ("drill",)),
    "mega_elf": Build("atmega2560", 2, "avr-mega", ("impact", "drill")),
}
# Each case on the Uno with the build of its tool, and on the Mega.
RUNS = [
    (case, build)
    for case, run in CASES.items()
    for build in (("drill_elf" if run.mode == "drill" else "uno_elf"), "mega_elf")
]
UNO_RUNS = [(case, build) for case, build in RUNS if BUILDS[build].mcu == "atmega328p"]
