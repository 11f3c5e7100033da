"""What scripts and pipelines use of the command line: exit codes, JUnit, batches, standard output,
several files all or none, progress, version, completion.
"""

import gc
import itertools
import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF, Signal

from test_recording_ends import on_terminal
from vgroove.errors import VgrooveError
from vgroove.gap import DiagnosisOptions
from vgroove.gap import diagnose as diagnose_logs
from vgroove.gap.cases import read_cases
from vgroove.gap.catalogue import CATALOGUE
from vgroove.gap.residual.loading import load_problem
from vgroove.gap.stage_shares import SHARES, StageShare
from vgroove.log import Log, read_log, write_csv
from vgroove.output import write_all
from vgroove.result_files import SCRIPT_NAME
from vgroove.rig import read_rig
from warm_cli import Settings, warm_vgroove

ROOT = Path(__file__).resolve().parents[2]
VGROOVE = [sys.executable, "-m", "vgroove"]
KEPT = ("winding_resistance", "coulomb_friction")  # effects of a diagnosis that takes a second
WITHOUT = [e.id for e in CATALOGUE if e.id not in KEPT]
FEW_EFFECTS = [word for name in WITHOUT for word in ("--without", name)]
RIG = """schema = "vgroove.rig/1"
name = "small"
[input]
kind = "duty"
[supply]
voltage_v = 18.0
[motor]
resistance_ohm = 0.19
inductance_h = 1e-4
torque_constant_nm_per_a = 0.0109
inertia_kg_m2 = 1.8e-5
viscous_nm_s_per_rad = 4.5e-6
coulomb_nm = 0.012
[gearbox]
ratio = 1.0
output_inertia_kg_m2 = 0.0
[load]
kind = "none"
[mechanism]
kind = "none"
[sensors]
log_hz = 1000
current_noise_a = 0.15
speed_lsb_rpm = 10.0
supply_noise_v = 0.02
"""


def vgroove(*arguments: object, limit: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run the command line; a file larger than `limit` bytes fails as on a full disk."""

    return warm_vgroove(*arguments, settings=Settings(limit=limit))


@pytest.fixture(scope="module")
def tool(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with rig.toml and the log of a run of 0.6 s with noise."""
    folder = tmp_path_factory.mktemp("tool")
    (folder / "rig.toml").write_text(RIG)
    done = vgroove("sim", folder / "rig.toml", "--seconds", 0.6, "-o", folder / "log.csv")
    assert done.returncode == 0, done.stderr
    log, rng = read_log(folder / "log.csv"), np.random.default_rng(1)
    assert len(log) == 601
    columns = {name: log[name] for name in ("duty", "current_a", "speed_rpm")}
    columns["current_a"] = columns["current_a"] + rng.normal(0.0, 0.15, len(log))
    columns["speed_rpm"] = 10.0 * np.round(columns["speed_rpm"] / 10.0)
    write_csv(Log(log.time_s, columns, "x"), folder / "log.csv")
    return folder


def diagnose(tool: Path, *options: object, **more: int) -> subprocess.CompletedProcess[str]:
    return vgroove(
        *("gap", "diagnose", tool / "log.csv", "--rig", tool / "rig.toml"),
        *FEW_EFFECTS,
        *options,
        **more,
    )


def test_a_gap_above_the_limit_is_exit_code_3_and_a_failure_in_junit(
    tool: Path, tmp_path: Path
) -> None:
    done = diagnose(tool, "--fail-above", 0.01, "--junit", tmp_path / "j.xml", "--json", "-")
    assert done.returncode == 3 and "above 0.01" in done.stderr, done.stderr
    verdict = json.loads(done.stdout)
    assert verdict["gap"]["after"] > 0.01 and "No gap beyond the noise" in done.stderr
    suite = ElementTree.parse(tmp_path / "j.xml").getroot().find("testsuite")
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("1", "1", "0")
    assert "above 0.01" in suite.find("testcase/failure").get("message")


def test_a_full_disk_leaves_none_of_the_files_of_a_diagnosis(tool: Path, tmp_path: Path) -> None:
    """The JSON has room, the page (5 MB) has not."""
    done = diagnose(
        tool, "--json", tmp_path / "v.json", "--html", tmp_path / "v.html", limit=1_000_000
    )
    assert done.returncode == 2 and f"{tmp_path / 'v.html'}: cannot be written" in done.stderr
    assert os.listdir(tmp_path) == [] and "Traceback" not in done.stderr


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A separate disk with room for 108 kB; the test is skipped where mounting is not allowed."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=108k", "vgroove-test", folder]
    if subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("a small disk can only be mounted by root")
    yield folder
    subprocess.run(["umount", folder], check=True)


def test_a_disk_with_room_for_one_of_two_files_gets_none_and_keeps_the_old(
    small_disk: Path,
) -> None:
    old, other = small_disk / "old.json", small_disk / "other.csv"
    old.write_text("old")
    with pytest.raises(VgrooveError, match="other.csv: cannot be written: No space left"):
        write_all([(old, "n" * 50_000), (other, "n" * 90_000)])
    assert old.read_text() == "old" and os.listdir(small_disk) == ["old.json"]
    write_all([(old, "new"), (other, b"new")])
    assert old.read_text() == other.read_text() == "new"


@pytest.mark.parametrize("command", [["effects"], ["sim", "rigs/impact_driver.toml"]])
def test_json_on_standard_output_is_alone_there(command: list[str]) -> None:
    more = ["--seconds", "0.1"] if command[0] == "sim" else []
    command = [*VGROOVE, *command, *more, "--json", "-"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr != "" and not (ROOT / "-").exists()
    assert json.loads(done.stdout)["schema"].startswith("vgroove.")


@pytest.mark.parametrize("more", [[], ["--json", "-"], ["--json", "/dev/full"]])
def test_a_full_device_is_a_sentence(more: list[str]) -> None:
    with open("/dev/full", "w") as full:
        command = [*VGROOVE, "effects", *more]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2 and "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr and len(done.stderr.splitlines()) == 1, done.stderr
    with pytest.raises(VgrooveError, match="/dev/full: cannot be written: No space left"):
        write_all([(Path("/dev/full"), "text")])


def test_standard_output_takes_one_file() -> None:
    done = vgroove("sim", ROOT / "rigs/impact_driver.toml", "--json", "-", "-o", "-")
    assert done.returncode == 2 and "standard output takes one of the files" in done.stderr


def test_a_batch_goes_on_after_a_case_that_fails(tool: Path, tmp_path: Path) -> None:
    case = '[[case]]\nname = "{}"\nlogs = ["{}"]\nrig = "{}"\nwithout = {}\n'
    names = [("first", "log.csv"), ("lost", "none.csv"), ("last", "log.csv")]
    text = "".join(case.format(n, tool / log, tool / "rig.toml", WITHOUT) for n, log in names)
    (tmp_path / "cases.toml").write_text(text)
    files = ["--json", tmp_path / "b.json", "--junit", tmp_path / "b.xml", "--fail-above", 0.01]
    files += ["--html", tmp_path / "pages"]
    done = vgroove("gap", "batch", tmp_path / "cases.toml", *files)
    assert done.returncode == 2, done.stderr
    found = json.loads((tmp_path / "b.json").read_text())
    assert [one["name"] for one in found["cases"]] == ["first", "lost", "last"]
    assert [one["verdict"] is None for one in found["cases"]] == [False, True, False]
    assert "none.csv: cannot be read" in found["cases"][1]["error"]
    assert found["errors"] == 1 and found["above"] == ["first", "last"]
    suite = ElementTree.parse(tmp_path / "b.xml").getroot().find("testsuite")
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("3", "2", "1")
    assert [test.get("name") for test in suite] == ["first", "lost", "last"]
    assert "lost" in done.stdout and "none.csv" in done.stdout and "Traceback" not in done.stderr
    pages = {path.name: path.read_text() for path in (tmp_path / "pages").iterdir()}
    assert set(pages) == {"001_first.html", "003_last.html", "index.html", SCRIPT_NAME}
    assert "<a href='001_first.html'>first</a>" in pages["index.html"]
    assert "002_" not in pages["index.html"] and "none.csv" in pages["index.html"]
    assert f"src='{SCRIPT_NAME}'" in pages["001_first.html"] and len(pages["001_first.html"]) < 2e6


def test_a_folder_is_a_case_and_a_folder_of_folders_is_several(tmp_path: Path) -> None:
    for name in ("b", "a"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "rig.toml").touch()
        for log in ("2.csv", "1.blf", ".hidden.part.csv", "label.json"):
            (tmp_path / name / log).touch()
    cases = read_cases([tmp_path])
    assert [case.name for case in cases] == ["a", "b"]
    assert [log.name for log in cases[0].logs] == ["1.blf", "2.csv"]
    assert read_cases([tmp_path / "b"]) == cases[1:]


CASE = "[[case]]\nname = 'a'\nlogs = ['l']\nrig = 'r'\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "list of tables"),
        (
            "[[case]]\nname = 'a'\nlogs = ['l']\nrigg = 'r'",
            "case 1: the key rigg is unknown; .*rig",
        ),
        ("[[case]]\nname = 'a'\nrig = 'r'", "case 1: the key logs is missing"),
        ("[[case]]\nname = 'a'\nlogs = 'l'\nrig = 'r'", "the key logs has a value of the wrong"),
        ("[[case]]\nname = 'a'\nlogs = [1]\nrig = 'r'", "are lists of texts"),
        (f"{CASE}seed = -1", "case 1: seed .*, not -1"),
        ("case = [1, 2]", "case 1: is no table"),
        ("case = [[1]]", "case 1: is no table"),
        ("case = ['a']", "case 1: is no table"),
        (f"{CASE}seed = true", "case 1: the key seed has a value of the wrong type"),
        (f"{CASE}from_s = true", "case 1: the key from_s has a value of the wrong type"),
        (f"{CASE}to_s = false", "case 1: the key to_s has a value of the wrong type"),
        (f"{CASE}as_is = 1", "case 1: the key as_is has a value of the wrong type"),
        (f"{CASE}map = ['bad']", "case 1: --map 'bad': must be"),
        (2 * CASE, "two cases have the name a"),
    ],
)
def test_an_unusable_batch_is_refused_before_the_work(
    tmp_path: Path, text: str, words: str
) -> None:
    (tmp_path / "cases.toml").write_text(text)
    with pytest.raises(VgrooveError, match=words):
        read_cases([tmp_path / "cases.toml"])


@pytest.mark.parametrize("seed", [-1, 0.5, True, "1", None])
def test_a_seed_that_is_no_whole_number_from_0_on_is_refused(seed: object) -> None:
    with pytest.raises(VgrooveError, match="seed must be a whole number of 0 or more, not"):
        DiagnosisOptions(seed=seed)
    assert DiagnosisOptions(seed=np.int64(3)).seed == 3


def test_a_diagnosis_shows_its_stage_and_share_on_a_terminal(tool: Path) -> None:
    command = [*VGROOVE, "gap", "diagnose", str(tool / "log.csv"), "--rig", str(tool / "rig.toml")]
    process, terminal = on_terminal([*command, *FEW_EFFECTS])
    shown = bytearray()
    try:
        while block := os.read(terminal, 4096):
            shown += block
    except OSError:  # the process has ended and closed its end
        pass
    os.close(terminal)
    assert process.wait(60) == 0
    text = shown.decode()
    assert "reading the logs" in text and " 0 %" in text
    assert "what remains, and where the gap lies" in text and " 93 %" in text


def test_the_share_of_a_diagnosis_grows() -> None:
    share = StageShare()
    stages = [*list(SHARES)[:5], "a further effect beside a, b", *list(SHARES)[5:], "rivals"]
    shares = [share.at(stage) for stage in stages]
    assert shares == sorted(shares) and shares[0] == 0.0 and 0.9 < shares[-1] < 1.0


def test_a_stage_reports_each_batch_of_its_simulations(tool: Path) -> None:
    texts: list[str] = []
    options = DiagnosisOptions(without=WITHOUT, progress=texts.append)
    diagnose_logs(tool / "log.csv", read_rig(tool / "rig.toml"), options)
    assert texts.count("each effect alone") >= 5, texts


def test_a_stage_that_goes_on_approaches_the_next_one() -> None:
    share = StageShare()
    shares = [share.at("each effect alone") for _ in range(60)]
    assert all(a < b for a, b in itertools.pairwise(shares)) and 0.5 < shares[-1] < 0.55
    assert share.at("a further effect beside a") == 0.55
    shares = [share.at("a further effect beside a") for _ in range(60)]
    assert all(a < b for a, b in itertools.pairwise(shares)) and shares[-1] < 0.71


def test_the_length_of_a_simulated_run_can_be_chosen(tmp_path: Path) -> None:
    scenario = ROOT / "scenarios/spin_up.toml"
    done = vgroove("sim", scenario, "--seconds", 0.25, "-o", tmp_path / "a.csv")
    assert done.returncode == 0 and len(read_log(tmp_path / "a.csv")) == 251
    for wrong in ("0", "nan", "1e9"):
        done = vgroove("sim", scenario, "--seconds", wrong)
        assert done.returncode == 2 and "--seconds must be from 0.01 to 3600" in done.stderr


@pytest.mark.parametrize(
    ("command", "option", "value"),
    [
        ("gap diagnose a.csv --rig rigs/pendulum.toml", "--seed", "-1"),
        ("bench trap", "--seed", "-1"),
        ("bench speed --seconds 1 --repeats 1", "--seed", "-1"),
        ("run --on /dev/none --experiment reversal -o a.csv", "--baud", "0"),
        ("hil scenarios/spin_up.toml --port /dev/none", "--baud", "0"),
        ("record /dev/none -o a.csv", "--baud", "0"),
        ("record /dev/none -o a.csv", "--seconds", "-1"),
        ("record /dev/none -o a.csv", "--seconds", "nan"),
    ],
)
def test_a_number_below_its_range_is_refused(command: str, option: str, value: str) -> None:
    done = vgroove(*command.split(), option, value)
    assert done.returncode == 2 and f"Invalid value for '{option}'" in done.stderr, done.stderr


def test_values_that_no_sensor_gives_are_refused_in_a_sentence(tool: Path, tmp_path: Path) -> None:
    log, small_rig = read_log(tool / "log.csv"), read_rig(tool / "rig.toml")
    for large in (-1e300, 1e20, 1e200):
        log.columns["current_a"][300:320] = large
        with pytest.raises(VgrooveError, match="column current_a is .* no sensor measures"):
            load_problem([log], small_rig)
    write_csv(log, tmp_path / "log.csv")
    said = {
        (): "column current_a: reaches 1e+200, more than any tool",
        ("--as-is",): "column current_a is 1e+200 A at 0.3 s, which no sensor measures",
    }
    for options, sentence in said.items():
        command = ("gap", "diagnose", tmp_path / "log.csv", "--rig", tool / "rig.toml", *options)
        done = vgroove(*command)
        assert done.returncode == 2 and "Traceback" not in done.stderr
        assert sentence in done.stderr


def test_a_truncated_mf4_prints_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """asammdf's destructor must not fail either: what it raises cannot be caught."""
    time_s, uncaught = np.arange(500) / 1000, []
    monkeypatch.setattr(sys, "unraisablehook", lambda found: uncaught.append(found.exc_value))
    with MDF(version="4.10") as mdf:
        names = ("duty", "current_a", "speed_rpm")
        mdf.append([Signal(np.sin(time_s), time_s, name=n, unit="A") for n in names])
        mdf.save(tmp_path / "whole.mf4", overwrite=True)
    whole = (tmp_path / "whole.mf4").read_bytes()
    for size in (20, 100, 2_000, len(whole) - 100):
        (tmp_path / "cut.mf4").write_bytes(whole[:size])
        with pytest.raises(VgrooveError, match="is a damaged or truncated MF4 file"):
            read_log(tmp_path / "cut.mf4")
    gc.collect()
    assert uncaught == []


def test_version_and_completion() -> None:
    assert vgroove("--version").stdout.startswith("vgroove 0.")
    quiet = {**os.environ, "_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    script = subprocess.run(
        [*VGROOVE, "--show-completion", "bash"],
        capture_output=True,
        text=True,
        env=quiet,
        check=True,
    )
    assert "complete" in script.stdout
    words = {"COMP_WORDS": "vgroove gap ", "COMP_CWORD": "2", "_VGROOVE_COMPLETE": "complete_bash"}
    program = Path(sys.executable).with_name("vgroove")
    done = subprocess.run(
        [program], capture_output=True, text=True, env={**os.environ, **words}, check=False
    )
    assert {"diagnose", "batch"} <= set(done.stdout.split())
