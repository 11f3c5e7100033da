"""Options of another mode of a command are refused, and by their name."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from vgroove.cli import app
from vgroove.errors import VgrooveError

SCENARIO = Path(__file__).resolve().parents[2] / "scenarios" / "impact_hard_joint.toml"
RIG = Path(__file__).resolve().parents[2] / "rigs" / "impact_driver.toml"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["run", SCENARIO, "--baud", "250000"], "--baud: --on sil and --on avr run a SCENARIO"),
        (["run", SCENARIO, "--no-wait"], "--wait/--no-wait: only a run with --pty"),
        (["run", SCENARIO, "--target", "uno"], "--target: only a run with --on avr"),
        (["run", SCENARIO, "--stats", "s.json"], "--stats: only a run with --on avr"),
        (
            ["run", "--on", "/dev/ttyNone", "--no-wait"],
            "--wait/--no-wait: a run on a board",
        ),
        (["hil", SCENARIO, "--bus", "virtual:x", "--baud", "9600"], "--baud: the rate of a bus"),
        (["adapt", RIG, "--baud", "115200"], "--baud: the rate of --port, which is not given"),
        (["adapt", RIG, "--target", "mega"], "--target: the board of -o, which is not given"),
    ],
)
def test_an_option_of_another_mode_is_refused(arguments: list[object], sentence: str) -> None:
    error = CliRunner().invoke(app, list(map(str, arguments))).exception
    assert isinstance(error, VgrooveError)
    assert str(error).startswith(sentence)
