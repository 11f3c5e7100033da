"""Logs from the board's telemetry: from bytes, or from the rows of a session. The rules of
docs/spec/gap.md, section 1, are not checked, since such a log may have fewer rows than required.
"""

from vgroove import telemetry
from vgroove.log.table import Log


def log_from_stream(data: bytes, source: str) -> Log:
    """A log from the bytes that a board sent since its start; damage is counted in
    meta['counters'].
    """
    session = telemetry.Session()
    session.feed(telemetry.Framer(session.counters).feed(data))
    return log_from_session(session, source)


def log_from_session(session: telemetry.Session, source: str) -> Log:
    """A log of all rows that a session holds."""
    columns = session.take_rows()
    return Log(columns.pop("time_s"), columns, source, meta=session.metadata())
