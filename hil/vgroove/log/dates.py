"""Times that a file holds as dates or times of day instead of numbers."""

import re
from datetime import UTC, datetime, timedelta

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
TIME_OF_DAY = re.compile(r"(\d{1,2}):(\d\d):(\d\d(?:[.,]\d+)?)")
LOOKS_LIKE_DATE = re.compile(r"\d+[-./:]\d+[-./:]\d+")


def seconds_of_date(cell: str) -> float | None:
    """Seconds of an ISO 8601 date with time since 1970 (without a time zone: UTC), or of a time of
    day hh:mm:ss since midnight; None for anything else.
    """
    cell = cell.strip()
    if not LOOKS_LIKE_DATE.match(cell):
        return None
    if of_day := TIME_OF_DAY.fullmatch(cell):
        hours, minutes, seconds = of_day[1], of_day[2], of_day[3].replace(",", ".")
        return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds)
    try:
        moment = datetime.fromisoformat(cell)
    except ValueError:
        return None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    return (moment - EPOCH) / timedelta(seconds=1)
