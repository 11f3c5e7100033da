"""Generate firmware_vectors.h, golden vectors of the firmware's arithmetic computed with exact
rationals and without its code; --check only compares.
"""

import argparse
import random
import sys
from fractions import Fraction
from math import floor
from pathlib import Path

OUT = Path(__file__).with_name("firmware_vectors.h")
SEED = 20261121


def nearest(value: Fraction) -> int:
    """Nearest integer, halves up."""
    return floor(value + Fraction(1, 2))


def saturate(value: int) -> int:
    return max(-32768, min(32767, value))


def mean_q4(total: int, count: int) -> int:
    """Mean of `count` ADC counts in 1/16; the firmware multiplies by 2^20 / count truncated to an
    integer (rounded for 6) and shifts.
    """
    factor = {
        1: 1048576,
        2: 524288,
        3: 349525,
        4: 262144,
        5: 209715,
        6: 174763,
        7: 149797,
        8: 131072,
    }[count]
    assert abs(Fraction(factor) - Fraction(1 << 20, count)) < 1
    return nearest(Fraction(total * factor, 1 << 16))


def current_a_q9(mean: int, gain_a_q15: int) -> int:
    """Amperes Q9 of a mean in counts Q4 with the offset at mid-scale."""
    return saturate(nearest(Fraction(mean - 8192, 16) * Fraction(gain_a_q15, 1 << 15) * 512))


def compare(duty_q15: int) -> int:
    """Signed compare value, rounded to nearest, symmetric."""
    size = nearest(Fraction(abs(duty_q15), 1 << 15) * 255)
    return -size if duty_q15 < 0 else size


def supply_mv(counts: int, gain_mv_q8: int) -> int:
    return nearest(Fraction(counts * gain_mv_q8, 256))


def supply_25mv(mv: int) -> int:
    return min(1023, nearest(Fraction(mv, 25)))


def temperature_c_q4(counts: int) -> int:
    return nearest((Fraction(counts) * 5 / 1024 / Fraction(1, 100) - 50) * 16)


def travel_q15(counts: int, low: int) -> int:
    """Travel for an upper dead band at low + 820, pressed from rest: 0 up to 4 counts beyond the
    lower one; the firmware's factor is truncated to 7 binary places.
    """
    if counts <= low + 4:
        return 0
    return (
        32767 if counts >= low + 820 else floor(Fraction((counts - low) * ((1 << 22) // 820), 128))
    )


def speed_rpm_q1(period: int, pulses: int) -> int:
    """Speed of two edges `period` cycles apart: nearest half rpm, saturated."""
    return min(32767, nearest(Fraction(2 * 60 * 16_000_000 // pulses, period)))


def slewed(now: int, target: int) -> int:
    """One step of at most 197 (6 per second at 1 kHz)."""
    return now + max(-197, min(197, target - now))


def divided(dividend: int, divisor: int) -> int:
    """Quotient of 32-bit numbers without sign, at most 65,535; of a divisor of 0 that."""
    dividend, divisor = dividend % 2**32, divisor % 2**32
    return min(65535, dividend // divisor) if divisor else 65535


def folded_back(requested: int, current: int) -> int:
    """First step of the fold-back with a limit of 40 A: duty after an excess of the current."""
    limit = 40 * 512
    if abs(current) <= limit:
        return max(0, requested)
    size = max(0, min(32767 << 8, (abs(current) - limit) * 41))
    change = floor(Fraction(-size if current > 0 else size, 256))
    return max(0, min(32767, requested + change))


def cases() -> list[tuple[str, int, int, int]]:
    """(function, a, b, expected): ends of each range, their neighbours, seeded values between."""
    draw = random.Random(SEED)
    edge16 = [-32768, -32767, -129, -128, -1, 0, 1, 127, 128, 255, 256, 32766, 32767]
    out = [
        ("SATURATE", v, 0, saturate(v))
        for v in (*edge16, 32768, -32769, 65535, 65536, -65536, 2**31 - 1, -(2**31))
    ]
    for count in range(1, 9):
        out += [
            ("MEAN", t, count, mean_q4(t, count))
            for t in (0, 1, 512 * count, 1023 * count, draw.randrange(1023 * count))
        ]
    for gain in (1024, 4096, 4097, 16384):
        means = (0, 8191, 8192, 8193, 16368, 8192 + 2047, 8192 + 2048, draw.randrange(16368))
        out += [("CURRENT", m, gain, current_a_q9(m, gain)) for m in means]
    out += [
        ("COMPARE", d, 0, compare(d))
        for d in (*edge16, *(draw.randrange(-32768, 32768) for _ in range(20)))
    ]
    out += [
        ("SUPPLY", c, g, supply_mv(c, g))
        for c in (0, 1, 511, 740, 1023)
        for g in (2560, 6400, 12800)
    ]
    out += [
        ("SUPPLY_25MV", v, 0, supply_25mv(v))
        for v in (0, 12, 13, 37, 38, 18500, 25587, 25588, 51150)
    ]
    out += [("TEMPERATURE", c, 0, temperature_c_q4(c)) for c in (20, 102, 103, 154, 287, 1003)]
    out += [
        ("TRAVEL", c, low, travel_q15(c, low))
        for low in (0, 100)
        for c in (low, low + 4, low + 5, 410 + low, low + 819, low + 820, 1023)
    ]
    periods = (14648, 14649, 15238, 16000, 65535, 65536, 65537, 100000, 1000003, 4000000, 4799999)
    out += [
        ("SPEED", p, n, speed_rpm_q1(p, n))
        for p in periods
        for n in (1, 4)
        if speed_rpm_q1(p, n) < 32767 or n == 4
    ]
    out += [
        ("SPEED", p, 4, speed_rpm_q1(p, 4))
        for p in (draw.randrange(14600, 4_800_000) for _ in range(20))
    ]
    out += [
        ("SLEW", a, b, slewed(a, b))
        for a in (-32768, 0, 32767)
        for b in (-32768, -198, -197, 0, 197, 198, 32767)
    ]
    ends32 = (0, 1, 65534, 65535, 65536, 65537, 2**31 - 1, -(2**31), -2, -1)
    out += [("DIVIDE", a, b, divided(a, b)) for a in ends32 for b in ends32]
    out += [
        ("FOLDBACK", r, c, folded_back(r, c))
        for r in (-2, -1, 0, 1, 16384, 32766, 32767)
        for c in (-32768, -32767, -20481, -20480, -1, 0, 1, 20480, 20481, 32766, 32767)
    ]
    return out


def text() -> str:
    rows = cases()
    names = list(dict.fromkeys(row[0] for row in rows))
    lines = [
        "// Golden vectors of the firmware's arithmetic: {function, a, b, expected}.",
        "// Generated by make_vectors.py: edit that, not this.",
        "#ifndef VGROOVE_TESTS_FIRMWARE_VECTORS_H",
        "#define VGROOVE_TESTS_FIRMWARE_VECTORS_H",
        "",
        "enum {",
    ]
    lines += [f"    VECTORS_{name}," for name in names] + [
        "};",
        "",
        f"#define VECTORS_COUNT {len(rows)}u",
        "",
        "#define VECTORS_TABLE \\",
    ]
    least = {-(2**31): "(-2147483647 - 1)"}
    lines += [f"    {{VECTORS_{n}, {least.get(a, a)}, {b}, {e}}}, \\" for n, a, b, e in rows]
    return "\n".join(lines) + "\n    /* end */\n\n#endif\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true")
    if not parser.parse_args().check:
        OUT.write_text(text(), encoding="utf-8")
        return 0
    if OUT.read_text(encoding="utf-8") == text():
        return 0
    sys.stderr.write(f"{OUT.name} does not match make_vectors.py: run it\n")
    return 1


if __name__ == "__main__":
    raise SystemExit(main())
