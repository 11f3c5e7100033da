"""Times that a file holds as dates or times of day instead of numbers."""

import re
from datetime import UTC, datetime, timedelta

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
# hh:mm:ss with a fraction or three digits behind one more colon, or mm:ss with a fraction
TIME_OF_DAY = re.compile(
    r"(?:(\d{1,2}):)?(\d{1,2}):(\d\d(?:[.,]\d+)?|\d\d:\d{3})\s*([AP]M)?", re.IGNORECASE
)
LOOKS_LIKE_DATE = re.compile(r"\d+[-./:]\d+[-./:]\d+|\d+:\d\d[.,]\d")
YEAR_FIRST = re.compile(r"(\d{4})([-/.])(\d{1,2})\2(\d{1,2})")
YEAR_LAST = re.compile(r"(\d{1,2})([-/.])(\d{1,2})\2(\d{4})")
HOURS_OF_HALF_DAY = 12


def seconds_of_date(cell: str) -> float | None:
    """Seconds of a date with time since 1970 (without a time zone: UTC), or of a time of day since
    midnight; None for anything else, and for a date of which the day and the month may be swapped.

    Dates are those of ISO 8601, also with / or . as in 2026/03/31, and 31.03.2026; 03/31/2026 where
    a number above 12, AM or PM shows which one is the month.
    """
    cell = cell.strip()
    if not LOOKS_LIKE_DATE.match(cell):
        return None
    if TIME_OF_DAY.fullmatch(cell):
        return _seconds_of_day(cell)
    day, _, time = cell.replace("T", " ").partition(" ")
    midnight = _midnight(day, time)
    if midnight is not None and TIME_OF_DAY.fullmatch(time.strip()):
        seconds = _seconds_of_day(time.strip())
        return None if seconds is None else (midnight - EPOCH) / timedelta(seconds=1) + seconds
    try:
        moment = datetime.fromisoformat(cell)
    except ValueError:
        return None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return (moment - EPOCH) / timedelta(seconds=1)


def _seconds_of_day(text: str) -> float | None:
    """Seconds since midnight of a time of day that TIME_OF_DAY matches; None for one that is
    none: mm:ss without a fraction, 13:00 PM.
    """
    hours, minutes, seconds, half = TIME_OF_DAY.fullmatch(text).groups()
    if hours is None and (half or len(seconds) == 2 or ":" in seconds):
        return None
    hour = int(hours or 0)
    if half:
        if not 1 <= hour <= HOURS_OF_HALF_DAY:
            return None
        hour = hour % HOURS_OF_HALF_DAY + HOURS_OF_HALF_DAY * (half.upper() == "PM")
    parts = seconds.replace(",", ".").replace(":", ".")
    return 3600.0 * hour + 60.0 * int(minutes) + float(parts)


def _midnight(day: str, time: str) -> datetime | None:
    """The begin of a day; None where it is none, or its day and month may be swapped."""
    if found := YEAR_FIRST.fullmatch(day):
        year, month, number = int(found[1]), int(found[3]), int(found[4])
    elif found := YEAR_LAST.fullmatch(day):
        first, second, year = int(found[1]), int(found[3]), int(found[4])
        month_first = found[2] != "." and (second > 12 or time.upper().endswith("M"))
        if not month_first and found[2] != "." and first <= 12:
            return None
        month, number = (first, second) if month_first else (second, first)
    else:
        return None
    try:
        return datetime(year, month, number, tzinfo=UTC)
    except ValueError:
        return None
