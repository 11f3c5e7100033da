"""Generate C packing, data files and pages from the signal list (vgroove.dbc) and the parameter
list (param_table.h); --check only compares.
"""

import argparse
import difflib
import sys
from pathlib import Path

from cantools.database.can import Message, Signal
from signal_tables import telemetry_json, telemetry_page

sys.path.insert(0, str(Path(__file__).parent))  # also when loaded by a test
from parameter_list import PARAM_TABLE, parameters_json, parameters_page, read_parameters
from signal_list import DBC, NOTE, ROOT, messages, protocol_version

CRC8_POLYNOMIAL = 0x2F
CRC8_INIT = 0xFF
COLUMNS = 100


def crc8(data: bytes, crc: int = CRC8_INIT) -> int:
    """CRC-8 register after `data` without the final XOR, so that more data can follow."""
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = ((crc << 1) ^ CRC8_POLYNOMIAL if crc & 0x80 else crc << 1) & 0xFF
    return crc


def c_type(signal: Signal) -> str:
    """Smallest standard integer that holds a signal's raw value."""
    width = next(width for width in (8, 16, 32) if signal.length <= width)
    return f"{'' if signal.is_signed else 'u'}int{width}_t"


def raw_limits(signal: Signal) -> tuple[int, int]:
    """Least and greatest raw value of a signal's range."""
    scale = signal.scale
    return round((signal.minimum - signal.offset) / scale), round(
        (signal.maximum - signal.offset) / scale
    )


def c_literal(value: int, signal: Signal) -> str:
    """Integer constant of the signal's signedness; -2^31 as a difference: no literal overflows."""
    if not signal.is_signed:
        return f"{value}u"
    return "(-2147483647 - 1)" if value == -(2**31) else (f"({value})" if value < 0 else str(value))


def crc_signal(message: Message) -> Signal:
    """The CRC, last byte of a frame."""
    signal = next(s for s in message.signals if s.start == 56)
    if signal.length != 8 or message.length != 8:
        raise SystemExit(f"{DBC.name}: {message.name} must end in an 8-bit CRC")
    return signal


def payload(message: Message) -> list[Signal]:
    """All signals except the CRC, in the order of their bits."""
    crc = crc_signal(message)
    for signal in message.signals:
        if signal.byte_order != "little_endian":
            raise SystemExit(f"{DBC.name}: {message.name}.{signal.name} must be little-endian (@1)")
    return sorted((s for s in message.signals if s is not crc), key=lambda s: s.start)


def is_inbound(message: Message) -> bool:
    """Whether the host sends the frame."""
    return message.senders == ["HOST"]


def camel(name: str) -> str:
    """PARAM_TABLE -> ParamTable."""
    return "".join(part.capitalize() for part in name.split("_"))


def is_enumeration(signal: Signal) -> bool:
    """Whether the value table names 0, 1, 2, ... without a gap; faults and flags name bits."""
    return bool(signal.choices) and sorted(signal.choices) == list(range(len(signal.choices)))


def is_sent_on_change(signal: Signal) -> bool:
    """Whether the attribute GenSigSendType of a signal is OnChange."""
    attribute = signal.dbc.attributes.get("GenSigSendType")
    return bool(attribute) and attribute.definition.choices[attribute.value] == "OnChange"


def wrapped(line: str, separator: str, indent: int) -> list[str]:
    """A long line broken after `separator`, continuation lines indented by `indent` columns."""
    lines = []
    while len(line) > COLUMNS:
        at = line.rindex(separator, 0, COLUMNS) + len(separator)
        lines.append(line[:at].rstrip())
        line = " " * indent + line[at:]
    return [*lines, line]


def header_message(message: Message) -> list[str]:
    """Identifier, limits, value names and struct of one message."""
    prefix = f"TELEMETRY_{message.name}"
    seed = crc8(message.frame_id.to_bytes(4, "little"))
    lines = [
        f"#define {prefix}_ID {message.frame_id}u",
        f"#define {prefix}_CRC_SEED 0x{seed:02X}u  // CRC-8 register after the id",
    ]
    for signal in payload(message):
        name = f"TELEMETRY_{signal.name.upper()}"
        least, greatest = raw_limits(signal)
        lines.append(f"#define {name}_MIN {c_literal(least, signal)}")
        lines.append(f"#define {name}_MAX {c_literal(greatest, signal)}")
        choices = sorted((signal.choices or {}).items())
        for value, choice in choices:
            lines.append(f"#define {name}_{str(choice).upper()} {value}u")
        if is_enumeration(signal):
            lines.append(f"#define {name}_LAST {choices[-1][0]}u")
    lines.append("typedef struct {")
    for signal in payload(message):
        unit = f"{signal.scale!r} {signal.unit}" if signal.unit not in (None, "1") else ""
        lines.append(f"    {c_type(signal)} {signal.name};" + (f"  // {unit}" if unit else ""))
    return [*lines, f"}} Telemetry{camel(message.name)};", ""]


def snake(message: Message) -> str:
    """Name of a message within function names."""
    return message.name.lower()


def signature(kind: str, name: str, parameters: str, end: str) -> list[str]:
    """Lines of a function's signature, parameters aligned after the opening bracket."""
    head = f"{kind} {name}("
    return wrapped(f"{head}{parameters}){end}", ", ", len(head))


def prototype(message: Message, end: str) -> list[str]:
    """Signature of pack for outbound, of unpack (false: out of range) for inbound frames."""
    kind = f"Telemetry{camel(message.name)}"
    data = "uint8_t data[TELEMETRY_DATA_BYTES]"
    if is_inbound(message):
        name = f"telemetry_unpack_{snake(message)}"
        return signature("bool", name, f"{kind} *signals, const {data}", end)
    name = f"telemetry_pack_{snake(message)}"
    return signature("void", name, f"{data}, const {kind} *signals", end)


def macro(name: str, parameters: str, body: str, separator: str) -> list[str]:
    """A function-like macro whose body is broken after `separator`."""
    lines = [f"#define {name}({parameters})", *wrapped(f"    {body}", separator, 5)]
    return [line + " \\" for line in lines[:-1]] + lines[-1:]


def change_macros(message: Message) -> list[str]:
    """Comparison and copy of the contents of two frames, if a message has OnChange signals. Macros,
    since avr-gcc makes inline functions longer; widest signals first, which change most often.
    """
    changing = [signal for signal in payload(message) if is_sent_on_change(signal)]
    names = [signal.name for signal in sorted(changing, key=lambda signal: -signal.length)]
    if not names:
        return []
    prefix = f"TELEMETRY_{message.name}"
    terms = " || ".join(f"(before)->{name} != (now)->{name}" for name in names)
    contents = [s.name for s in payload(message) if not s.name.endswith(("_tick", "_counter"))]
    copies = ", ".join(f"(to)->{name} = (from)->{name}" for name in contents)
    return [
        "",
        f"// Whether a signal has changed whose change sends the frame {message.name}.",
        *macro(f"{prefix}_CHANGED", "before, now", f"({terms})", "|| "),
        "",
        "// Copies all signals but the tick and the counter of the frame.",
        *macro(f"{prefix}_COPY", "to, from", f"({copies})", ", "),
    ]


def header() -> str:
    """Text of telemetry_signals.h."""
    lines = [
        "// Identifiers, raw limits, structs and packing of every telemetry frame.",
        f"// {NOTE.format(source=DBC.name)}",
        "#ifndef VGROOVE_TELEMETRY_SIGNALS_H",
        "#define VGROOVE_TELEMETRY_SIGNALS_H",
        "",
        "#include <stdbool.h>",
        "#include <stdint.h>",
        "",
        "#define TELEMETRY_DATA_BYTES 8u  // the last one is the CRC, which packing does not write",
        "",
        f"#define TELEMETRY_PROTOCOL_VERSION {protocol_version()}u",
        "",
    ]
    for message in messages():
        lines += header_message(message)
    for message in messages():
        lines += prototype(message, ";")
    for message in messages():
        lines += change_macros(message)
    return "\n".join([*lines, "", "#endif", ""])


def bracketed(expression: str) -> str:
    """The expression in brackets unless it is a single operand."""
    return f"({expression})" if " " in expression else expression


def raw_value(signal: Signal) -> str:
    """C expression of a signal as an unsigned number."""
    width = 8 * ((signal.length + 7) // 8)
    width = 32 if width == 24 else width
    value = f"signals->{signal.name}"
    return f"(uint{width}_t){value}" if signal.is_signed else value


def is_shifted(signal: Signal) -> bool:
    """Whether a signal is shifted to its bit position once, in a local variable. Its bytes are then
    moves; on the AVR a shift by 3 to 7 bits for each byte would be a loop.
    """
    offset = signal.start % 8
    return (
        not signal.is_signed
        and signal.length > 8
        and 0 < offset
        and signal.length > 8 - offset
        and signal.length + offset <= 16
    )


def packed_part(signal: Signal, byte: int) -> str | None:
    """C expression (an int) of a signal's bits in a data byte; None if there are none."""
    first, last = signal.start, signal.start + signal.length - 1
    if last < 8 * byte or first > 8 * byte + 7:
        return None
    shift = 8 * byte - first
    top = last - 8 * byte  # bit of the byte that the signal's last bit would take
    if is_shifted(signal):
        return (
            f"{signal.name} & 0xFFu"
            if shift < 0
            else f"({signal.name} >> 8) & 0x{(1 << (top + 1)) - 1:X}u"
        )
    value = raw_value(signal)
    if shift > 0:
        value = f"{value} >> {shift}"
    if shift < 0:
        return f"({value} & 0x{(1 << min(signal.length, 8 + shift)) - 1:X}u) << {-shift}"
    return value if top >= 7 else f"{bracketed(value)} & 0x{(1 << (top + 1)) - 1:X}u"


def pack_function(message: Message) -> list[str]:
    """Packing: each byte is assembled from its signals; unused bits are 0."""
    lines = prototype(message, " {")
    for signal in filter(is_shifted, payload(message)):
        value = f"(uint16_t)(signals->{signal.name} << {signal.start % 8})"
        lines.append(f"    const uint16_t {signal.name} = {value};")
    for byte in range(7):
        parts = [part for signal in payload(message) if (part := packed_part(signal, byte))]
        value = " | ".join(bracketed(part) for part in parts) if len(parts) > 1 else "".join(parts)
        line = f"    data[{byte}] = (uint8_t)({value});" if parts else f"    data[{byte}] = 0u;"
        lines += wrapped(line, "| ", len(f"    data[{byte}] = (uint8_t)("))
    return [*lines, "}", ""]


def unpack_value(message: Message, signal: Signal) -> str:
    """C expression of an inbound signal, which must fill whole bytes."""
    if signal.start % 8 or signal.length not in (8, 16, 32):
        raise SystemExit(
            f"{DBC.name}: {message.name}.{signal.name} must fill 1, 2 or 4 whole bytes"
        )
    first = signal.start // 8
    wide = f"uint{signal.length}_t"
    places = range(signal.length // 8)
    parts = [
        f"({wide})data[{first + k}] << {8 * k}" if k else f"({wide})data[{first}]" for k in places
    ]
    value = " | ".join(bracketed(part) for part in parts)
    return (
        f"({c_type(signal)})({value})" if len(parts) > 1 or signal.is_signed else f"data[{first}]"
    )


def unpack_function(message: Message) -> list[str]:
    """Unpacking: reads every signal and returns whether all are within their ranges."""
    lines, checks = prototype(message, " {"), []
    for signal in payload(message):
        line = f"    signals->{signal.name} = {unpack_value(message, signal)};"
        lines += wrapped(line, "| ", 8)
        least, greatest = raw_limits(signal)
        name = f"TELEMETRY_{signal.name.upper()}"
        lower, upper = (
            (-(2 ** (signal.length - 1)), 2 ** (signal.length - 1) - 1)
            if signal.is_signed
            else (0, 2**signal.length - 1)
        )
        checks += [f"signals->{signal.name} >= {name}_MIN"] if least > lower else []
        checks += [f"signals->{signal.name} <= {name}_MAX"] if greatest < upper else []
    lines += wrapped(f"    return {' && '.join(checks) or 'true'};", "&& ", 11)
    return [*lines, "}", ""]


def source() -> str:
    """Text of telemetry_signals.c."""
    lines = [
        "// Packing and unpacking of every telemetry frame.",
        f"// {NOTE.format(source=DBC.name)}",
    ]
    lines += ['#include "telemetry/telemetry_signals.h"', ""]
    for message in messages():
        lines += unpack_function(message) if is_inbound(message) else pack_function(message)
    return "\n".join(lines)


def outputs() -> dict[Path, str]:
    """Path and text of every generated file."""
    version, parameters = read_parameters(PARAM_TABLE.read_text(encoding="utf-8"))
    page, note = ROOT / "docs/telemetry.md", NOTE.format(source=DBC.name)
    return {
        ROOT / "firmware/telemetry/telemetry_signals.h": header(),
        ROOT / "firmware/telemetry/telemetry_signals.c": source(),
        ROOT / "hil/vgroove/data/vgroove.dbc": DBC.read_text(encoding="utf-8"),
        ROOT / "hil/vgroove/data/telemetry.json": telemetry_json(
            messages(), protocol_version(), note
        ),
        page: telemetry_page(page.read_text(encoding="utf-8"), messages()),
        ROOT / "hil/vgroove/data/parameters.json": parameters_json(version, parameters),
        ROOT / "docs/parameters.md": parameters_page(version, parameters),
    }


def differences(texts: dict[Path, str]) -> list[str]:
    """Unified differences between the generated texts and the files in the tree."""
    found = []
    for path, text in texts.items():
        old = path.read_text(encoding="utf-8") if path.exists() else ""
        name = path.relative_to(ROOT).as_posix()
        found += difflib.unified_diff(
            old.splitlines(),
            text.splitlines(),
            f"{name} (checked in)",
            f"{name} (generated)",
            lineterm="",
            n=1,
        )
    return found


def main() -> None:
    """Write the generated files, or compare them with --check (exit code 1 and the differences)."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    if parser.parse_args().check:
        lines = differences(outputs())
        sys.stdout.write("".join(line + "\n" for line in lines))
        sys.exit(1 if lines else 0)
    for path, text in outputs().items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
