"""Tables made from the signal list besides the C code: telemetry.json for the Python package, and
the tables of docs/telemetry.md.
"""

import json
import re
from dataclasses import asdict, dataclass

from cantools.database.can import Message

HOST = "HOST"


@dataclass(frozen=True)
class Column:
    """A column of a log; `signal` of `frame` is its source, `unit` is empty for plain numbers."""

    name: str
    unit: str
    label: str
    frame: str
    signal: str


# Columns that the decoder computes from a signal: duty = compare value / full scale, coast = 1
# where the compare value is the least of its range (all transistors off).
COMPUTED_COLUMNS = {
    "duty": ("duty_compare", "duty"),
    "coast": ("duty_compare", "bridge open"),
}


def attribute(of: object, name: str) -> str:
    """Text of a DBC attribute of a message or signal; empty where it is not set."""
    attributes = (of.dbc.attributes if of.dbc else None) or {}
    return attributes[name].value if name in attributes else ""


def message_columns(message: Message) -> list[Column]:
    """Log columns that a message fills, in the order of its LogColumns; SystemExit for an unknown
    signal.
    """
    signals = {signal.name: signal for signal in message.signals}
    found = []
    for name in attribute(message, "LogColumns").split():
        source, label = COMPUTED_COLUMNS.get(name, (name, ""))
        if source not in signals:
            raise SystemExit(f"{message.name}: LogColumns names {name}, which is no signal of it")
        signal = signals[source]
        unit = "" if signal.unit in (None, "1") else signal.unit
        label = label or attribute(signal, "LogLabel") or name
        found.append(Column(name, unit, label, message.name, source))
    return found


def log_columns(messages: list[Message]) -> list[Column]:
    """Columns of every log, in the order of the frame ids; SystemExit where two have one name."""
    found = [column for message in messages for column in message_columns(message)]
    names = [column.name for column in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise SystemExit(f"LogColumns: {', '.join(twice)} is the name of two columns")
    return found


def telemetry_json(messages: list[Message], protocol_version: int, comment: str) -> str:
    """Protocol version, frame ids and log columns as the Python package reads them, which saves it
    the second that loading a DBC parser takes.
    """
    frames = [{"name": m.name, "id": m.frame_id, "inbound": m.senders == [HOST]} for m in messages]
    columns = [asdict(column) for column in log_columns(messages)]

    def rows(entries: list[dict]) -> str:
        return ",\n".join("    " + json.dumps(entry) for entry in entries)

    return (
        f'{{\n  "comment": {json.dumps(comment)},\n  "protocol_version": {protocol_version},\n'
        f'  "frames": [\n{rows(frames)}\n  ],\n  "columns": [\n{rows(columns)}\n  ]\n}}\n'
    )


def frames_table(messages: list[Message]) -> str:
    """Markdown table of the outbound frames: when each is sent (the first sentence of its comment)
    and its signals.
    """
    lines = ["| id | frame | sent | signals |", "| --- | --- | --- | --- |"]
    for message in messages:
        if message.senders == [HOST]:
            continue
        names = ", ".join(f"`{signal.name}`" for signal in message.signals if signal.start != 56)
        sent = re.split(r"\.(?= |$)", message.comment)[0]
        lines.append(f"| {message.frame_id} | {message.name} | {sent} | {names} |")
    return "\n".join(lines)


def columns_table(messages: list[Message]) -> str:
    """Markdown table of the log columns: unit, label and source."""
    lines = ["| column | unit | quantity | frame | signal |", "| --- | --- | --- | --- | --- |"]
    for column in log_columns(messages):
        cells = (f"`{column.name}`", column.unit or "1", column.label, column.frame)
        lines.append(f"| {' | '.join(cells)} | `{column.signal}` |")
    return "\n".join(lines)


def replace_table(page: str, name: str, table: str) -> str:
    """The page with the table after the mark of `name` replaced; SystemExit without the mark."""
    begin, end = f"<!-- table: {name} -->\n", "<!-- end of table -->"
    if begin not in page:
        raise SystemExit(f"docs/telemetry.md: the mark {begin.strip()} is missing")
    head, rest = page.split(begin, 1)
    return head + begin + table + "\n" + end + rest.split(end, 1)[1]


def telemetry_page(page: str, messages: list[Message]) -> str:
    """docs/telemetry.md with its generated tables."""
    page = replace_table(page, "frames", frames_table(messages))
    return replace_table(page, "log columns", columns_table(messages))
