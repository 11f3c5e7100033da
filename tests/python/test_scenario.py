"""Scenarios: what is read, what is refused and how the error reads; stimuli that a profile
makes.
"""

import struct
from pathlib import Path

import numpy as np
import pytest

from vgroove.board import PERIOD_S, SWITCH_CONTACT, SWITCH_REVERSE
from vgroove.errors import VgrooveError
from vgroove.lockstep import FrontEnds, Pacer, Profile, Script, StimulusSource
from vgroove.rig import read_rig
from vgroove.scenario import (
    command_messages,
    make_plant,
    read_scenario,
    without_board_effects,
)
from vgroove.telemetry import frame_crc

ROOT = Path(__file__).resolve().parents[2]
GOOD = """
schema = "vgroove.scenario/1"
rig = "{rig}"
duration_s = 1.0
seed = 3
[trigger]
travel = [[0.0, 0.0], [0.5, 1.0]]
reverse = [[0.0, false], [0.7, true]]
[load]
torque_nm = [[0.0, 0.0], [1.0, 0.5]]
[effects.coulomb_friction]
torque_nm = 0.02
[[command]]
time_s = 0.2
frame = "DUMP"
"""


LOADED = '[load]\nkind = "torque"'


def written(tmp_path: Path, text: str = GOOD) -> Path:
    """A scenario of the board's rig with a free output."""
    rig = (ROOT / "rigs" / "board_18v.toml").read_text().replace('[load]\nkind = "none"', LOADED)
    (tmp_path / "rig.toml").write_text(rig)
    path = tmp_path / "scenario.toml"
    path.write_text(text.replace("{rig}", "rig.toml"))
    return path


@pytest.mark.parametrize(
    "path", sorted((ROOT / "scenarios").glob("*.toml")), ids=lambda path: path.stem
)
def test_every_scenario_in_the_tree_is_valid(path: Path) -> None:
    scenario = read_scenario(path)
    assert scenario.duration_s > 0
    assert scenario.rig_path.exists()


def test_every_key_of_a_scenario_is_read(tmp_path: Path) -> None:
    scenario = read_scenario(written(tmp_path))
    assert (scenario.duration_s, scenario.seed) == (1.0, 3)
    assert scenario.profile.travel == ((0.0, 0.0), (0.5, 1.0))
    assert scenario.profile.reverse == ((0.0, 0.0), (0.7, 1.0))
    assert scenario.profile.load_nm == ((0.0, 0.0), (1.0, 0.5))
    assert scenario.commands[0].frame == "DUMP"


def test_effects_of_the_scenario_change_the_simulated_and_not_the_assumed_tool(
    tmp_path: Path,
) -> None:
    scenario = read_scenario(written(tmp_path))
    assert scenario.tool.effects["coulomb_friction"] == {"torque_nm": 0.02}
    assert "coulomb_friction" not in scenario.rig.effects
    assert "dead_time" in scenario.rig.effects and "dead_time" not in scenario.tool.effects
    assert "dead_time" not in without_board_effects(scenario.rig).effects


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("duration_s", "duration", "unknown key duration; the nearest known one is duration_s"),
        (
            "travel =",
            "travell =",
            r"\[trigger\]: unknown key travell; the nearest known one is travel",
        ),
        ("torque_nm = [[", "torque = [[", "unknown key torque; the nearest known one is torque_nm"),
        ("seed = 3", "seed = 3.5", "seed: must be a whole number"),
        ("seed = 3", "seed = true", "seed: must be a whole number"),
        ("duration_s = 1.0", "duration_s = -1.0", "duration_s: must be a number from 0.01"),
        ("duration_s = 1.0\n", "", "the key duration_s is missing"),
        ("[0.5, 1.0]", "[0.5, 1.5]", "value of point 2: must be a number from 0 to 1, not 1.5"),
        ("[0.5, 1.0]", "[0.5]", r"point 2: must be \[time_s, value\]"),
        ("[[0.0, 0.0], [0.5, 1.0]]", "[[0.5, 0.0], [0.2, 1.0]]", "its time 0.2 s comes before"),
        ("scenario/1", "scenario/2", 'this version reads "vgroove.scenario/1"'),
        ('"DUMP"', '"DUMPS"', "has no inbound frame DUMPS; the nearest known one is DUMP"),
        ('"DUMP"', '"PARAM_READ"', "read_index: must be a whole number from 0"),
        ('"DUMP"', '"DUMP"\nspeed = 1', "unknown key speed"),
        ("coulomb_friction", "coulomb_frictoin", "coulomb_friction"),
        ("seed = 3", "seed = ", "is not TOML"),
        ("torque_nm = 0.02", "torque_nm = [1, 2]", "torque_nm"),
        ("[effects.coulomb_friction]\ntorque_nm = 0.02", "[effects]\ndead_time = 5", "effects are"),
        ('frame = "DUMP"', 'frame = "SET_MODE"\nmode_request = 1.5', "must be a whole number"),
        ("time_s = 0.2", "time_s = 1.0", "DUMP at 1 s is after the end of the run"),
        ("{rig}", "a\\u0000b", "is no path"),
    ],
)
def test_errors_name_the_key_and_the_nearest_known_one(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    assert old in GOOD
    with pytest.raises(VgrooveError, match=sentence):
        read_scenario(written(tmp_path, GOOD.replace(old, new)))


def test_a_torque_beside_a_joint_is_refused(tmp_path: Path) -> None:
    text = GOOD.replace("{rig}", str(ROOT / "rigs" / "impact_driver.toml"))
    with pytest.raises(
        VgrooveError,
        match="load.torque_nm acts on a free output, but a hard_joint makes its own torque",
    ):
        read_scenario(written(tmp_path, text))
    without = text.replace("[load]\ntorque_nm = [[0.0, 0.0], [1.0, 0.5]]\n", "")
    assert read_scenario(written(tmp_path, without)).rig.load["kind"] == "hard_joint"


@pytest.mark.parametrize(("torque_nm", "refused"), [(0.0, False), (0.3, True)])
def test_a_torque_that_would_not_act_is_refused(
    torque_nm: float, refused: bool, tmp_path: Path
) -> None:
    text = GOOD.replace("{rig}", str(ROOT / "rigs" / "board_18v.toml"))
    path = written(tmp_path, text.replace("[1.0, 0.5]", f"[1.0, {torque_nm}]"))
    if refused:
        with pytest.raises(VgrooveError, match='with "none" it would not act'):
            read_scenario(path)
    else:
        assert read_scenario(path).profile.load_nm[-1] == (1.0, 0.0)


@pytest.mark.parametrize(("torque_nm", "refused"), [(0.5, False), (-0.5, True)])
def test_a_chuck_load_that_would_drive_is_refused(
    torque_nm: float, refused: bool, tmp_path: Path
) -> None:
    text = GOOD.replace("{rig}", str(ROOT / "rigs" / "drill_driver_low.toml"))
    text = text.replace("[effects.coulomb_friction]\ntorque_nm = 0.02\n", "")
    path = written(tmp_path, text.replace("[1.0, 0.5]", f"[1.0, {torque_nm}]"))
    if refused:
        with pytest.raises(VgrooveError, match="a chuck opposes its motion: it must be 0 N m"):
            read_scenario(path)
    else:
        assert read_scenario(path).profile.load_nm[-1] == (1.0, torque_nm)


def test_a_speed_lag_that_no_board_has_is_refused() -> None:
    rig = read_rig(ROOT / "rigs" / "board_18v.toml")
    for form, refused in (("filter", False), ("delay", False), ("mean", True)):
        tool = rig.with_effects({"speed_lag": {"time_constant_s": 0.01, "form": form}})
        if refused:
            with pytest.raises(VgrooveError, match='use form "filter" or "delay"'):
                make_plant(tool, 1)
        else:
            make_plant(tool, 1)


def test_missing_files_are_errors_with_a_message(tmp_path: Path) -> None:
    with pytest.raises(VgrooveError, match="cannot be read"):
        read_scenario(tmp_path / "none.toml")
    with pytest.raises(VgrooveError, match="no_rig.toml: cannot be read"):
        read_scenario(written(tmp_path, GOOD.replace("{rig}", "no_rig.toml")))


def test_commands_become_intact_frames(tmp_path: Path) -> None:
    ((time_s, data),) = command_messages(read_scenario(written(tmp_path)).commands)
    start, time_ms, length, frame_id, payload, end = struct.unpack("<BIBI8sB", data)
    assert (time_s, start, time_ms, length, frame_id, end) == (0.2, 0xAA, 200, 8, 515, 0xBB)
    assert payload[7] == frame_crc(200, 515, payload)


def test_stimuli_follow_the_profile_whatever_the_chunks() -> None:
    profile = Profile(
        travel=((0, 0), (0.01, 1)),
        reverse=((0, 0), (0.005, 1)),
        load_nm=((0, 0), (0.004, 0), (0.004, 2), (0.02, 2)),
        mode=2,
    )
    whole = StimulusSource(profile, FrontEnds(), 1).chunk(0, 400)
    parts = StimulusSource(profile, FrontEnds(), 1)
    first, second = parts.chunk(0, 150), parts.chunk(150, 250)
    for one, two, both in zip(first.columns(), second.columns(), whole.columns(), strict=True):
        assert np.array_equal(np.concatenate((one, two)), both)
    assert whole.trigger[0] == pytest.approx(0.1 * 1023, abs=3) and whole.trigger[-1] == round(
        0.9 * 1023
    )
    steps = [
        k for k in range(1, 400) if (whole.switches[k] ^ whole.switches[k - 1]) & SWITCH_REVERSE
    ]
    assert [round(k * PERIOD_S, 4) for k in steps] == [pytest.approx(0.005, abs=1e-4)]
    assert {switches >> 2 for switches in whole.switches} == {2}
    assert set(whole.load_nm) == {0.0, 2.0}


def test_contact_bounces_and_settles() -> None:
    stimulus = StimulusSource(
        Profile(travel=((0, 0), (0.01, 0), (0.01, 1), (1, 1)), bounce_s=0.004), FrontEnds(), 1
    )
    contact = np.array(stimulus.chunk(0, 1000).switches) & SWITCH_CONTACT
    changes = np.flatnonzero(np.diff(contact)) * PERIOD_S
    assert len(changes) > 10
    assert changes.min() >= 0.0099 and changes.max() <= 0.0142
    assert contact[-1] == 1


def test_noise_follows_the_seed() -> None:
    front = FrontEnds(current_noise_a=0.25)
    chunks = [
        StimulusSource(Profile(), front, seed).chunk(0, 4000).current_counts for seed in (1, 1, 2)
    ]
    assert np.array_equal(chunks[0], chunks[1]) and not np.array_equal(chunks[0], chunks[2])
    assert np.std(chunks[0]) * 0.125 == pytest.approx(0.25, rel=0.05)


def test_line_carries_250_kilobaud() -> None:
    pacer = Pacer()
    pacer.add(bytes(200) * 5)
    sent = [len(pacer.next()) for _ in range(1000)]
    assert max(sent) == 1
    assert sum(sent) == pytest.approx(1000 * 510 / 640, abs=2)


def test_script_sends_when_it_is_due() -> None:
    script = Script([(0.5, b"b"), (0.1, b"a")])
    assert [script.receive(t) for t in (0.05, 0.2, 0.2, 0.6)] == [b"", b"a", b"", b"b"]
