"""A signal that is added to the DBC appears in logs with its unit and label, without an edit of the
Python package: decoder, recorder files and log reader take it from the generated lists.
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import cantools
import pytest

from test_telemetry import ROOT, generator

SIGNALS = """ SG_ heat_sink_c : 53|3@1+ (10,0) [0|70] "degC" HOST
"""
FRAME = """BO_ 264 THERMAL: 8 VGROOVE
 SG_ thermal_tick : 0|8@1+ (1,0) [0|255] "ms" HOST
 SG_ winding_c : 8|16@1- (0.0625,-20) [-100|200] "degC" HOST
 SG_ thermal_crc : 56|8@1+ (1,0) [0|255] "1" HOST

"""
ATTRIBUTES = """BA_ "LogColumns" BO_ 264 "winding_c";
BA_ "LogLabel" SG_ 257 heat_sink_c "heat sink temperature";
BA_ "LogLabel" SG_ 264 winding_c "winding temperature";
"""
SCRIPT = """
import json, sys
from pathlib import Path
sys.meta_path = [f for f in sys.meta_path if "vgroove" not in type(f).__module__]
folder = Path(sys.argv[1])
sys.path.insert(0, str(folder))
from asammdf import MDF
from vgroove import log, telemetry
from vgroove.recording_files import CsvFile, Mf4File
assert Path(telemetry.__file__).is_relative_to(folder)

def sent(name, time_ms, **signals):
    return telemetry.frame_bytes(telemetry.frame_of_signals(name, time_ms, **signals))

data = sent("BOOT", 1, protocol_version=2, duty_full_scale=255, fast_divider=1)
data += sent("STATE", 2, state_tick=2, heat_sink_c=30)
data += sent("THERMAL", 2, thermal_tick=2, winding_c=41.5)
for k in range(100):
    if k == 50:
        data += sent("THERMAL", 52, thermal_tick=50, winding_c=60.25)
    data += sent("FAST", 3 + k, fast_counter=k % 16, current_a=1.0, duty_compare=200)
out = {"columns": telemetry.COLUMNS, "units": log.COLUMN_UNITS, "labels": log.COLUMN_LABELS}
for kind, name in ((CsvFile, "run.csv"), (Mf4File, "run.mf4")):
    session = telemetry.Session()
    session.feed(telemetry.Framer(session.counters).feed(data))
    file = kind(folder / name)
    file.add_rows(session.take_rows())
    file.finish()
    file.publish()
    read = log.read_log(folder / name)
    out[name] = {c: read[c].tolist() for c in ("heat_sink_c", "winding_c", "current_a")}
    out[name]["warnings"] = read.warnings
with MDF(str(folder / "run.mf4")) as mdf:
    channel = mdf.get("winding_c")
    out["channel"] = [channel.unit, channel.comment]
print(json.dumps(out))
"""


def changed_dbc() -> str:
    """The DBC with a signal more in STATE and a frame more."""
    text = (ROOT / "firmware/telemetry/vgroove.dbc").read_text("utf-8")
    for mark, before in (
        (" SG_ state_crc", SIGNALS),
        ("BO_ 512 SET_MODE", FRAME),
        ("VAL_ 257 state", ATTRIBUTES),
    ):
        assert text.count(mark) == 1
        text = text.replace(mark, before + mark)
    return text.replace('BO_ 257 "trigger state mode"', 'BO_ 257 "trigger state mode heat_sink_c"')


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the Python package with the lists that the generator makes of the changed DBC."""
    shutil.copytree(ROOT / "hil/vgroove", tmp_path / "vgroove")
    text = changed_dbc()
    database = cantools.database.load_string(text, "dbc", strict=True)
    messages = sorted(database.messages, key=lambda message: message.frame_id)
    generate = generator()
    monkeypatch.setattr(generate, "messages", lambda: tuple(messages))
    assert "uint8_t heat_sink_c;" in generate.header()
    assert "void telemetry_pack_thermal(" in generate.source()
    data = tmp_path / "vgroove/data"
    (data / "vgroove.dbc").write_text(text, encoding="utf-8")
    tables = generate.telemetry_json(messages, generate.protocol_version(), "")
    (data / "telemetry.json").write_text(tables, encoding="utf-8")
    return tmp_path


def test_a_new_signal_appears_in_logs_with_unit_and_label(package: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, package], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["columns"][8] == "heat_sink_c" and found["columns"][-1] == "winding_c"
    assert found["units"]["winding_c"] == found["units"]["heat_sink_c"] == "degC"
    assert found["labels"]["heat_sink_c"] == "heat sink temperature"
    assert found["channel"] == ["degC", "winding temperature"]
    for name in ("run.csv", "run.mf4"):
        rows = found[name]
        assert rows["heat_sink_c"] == [30.0] * 100 and rows["current_a"] == [1.0] * 100
        assert rows["winding_c"] == [41.5] * 47 + [60.25] * 53
        assert rows["warnings"] == []


def test_a_log_column_without_its_signal_is_refused() -> None:
    text = changed_dbc().replace('BO_ 264 "winding_c"', 'BO_ 264 "winding_k"')
    database = cantools.database.load_string(text, "dbc", strict=True)
    with pytest.raises(SystemExit, match="THERMAL: LogColumns names winding_k"):
        generator().telemetry_json(database.messages, 2, "")


def test_two_log_columns_of_one_name_are_refused() -> None:
    text = changed_dbc().replace("heat_sink_c", "winding_c")
    database = cantools.database.load_string(text, "dbc", strict=True)
    with pytest.raises(SystemExit, match="winding_c is the name of two columns"):
        generator().telemetry_json(database.messages, 2, "")
