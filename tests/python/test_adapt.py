"""`vgroove adapt`: the scale of a tool's levels, its parameters, the image with its map, and the
parameters on a board.
"""

import dataclasses
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from test_flash import hex_bytes
from test_run import elf, short_scenario, start_on_pty
from vgroove import telemetry
from vgroove.adapt import adaptation, torque_map
from vgroove.adapt import torque_map_file as maps
from vgroove.adapt.adaptation import Adaptation, check
from vgroove.adapt.firmware_image import adapted_image, map_in_flash
from vgroove.adapt.level_control import motor_of
from vgroove.adapt.level_scale import LevelScale, level_scale
from vgroove.adapt.setpoints import (
    beyond_controllers,
    beyond_range,
    check_tool,
    climb_share,
    default_value,
    needed_setpoints,
    setpoints,
)
from vgroove.board import AvrBoard
from vgroove.board_parameters import check_board, write_parameters
from vgroove.cli import app
from vgroove.control_bench import torque_adapted, torque_drawn
from vgroove.control_bench.draw import NOMINAL
from vgroove.control_bench.runs import pull, reference, sil_run
from vgroove.errors import VgrooveError
from vgroove.reference.rigs import reference_rig
from vgroove.rig import Rig
from vgroove.serial_bus import ResyncBus

ROOT = Path(__file__).resolve().parents[2]
REFERENCE = ROOT / "rigs" / "impact_driver.toml"
STEP = 0.0025  # of the levels' scale
SAME = LevelScale(1.0, 1.0, 1.0, 0.0)


def other_winding(share: float) -> Rig:
    """The reference tool with `share` times the turns of its winding and a supply to match: at
    `share` times the voltage it does exactly the same with the current over `share`.
    """
    rig = reference_rig()
    powers = {
        "motor.torque_constant_nm_per_a": 1,
        "motor.resistance_ohm": 2,
        "motor.inductance_h": 2,
        "supply.resistance_ohm": 2,
    }
    return rig.with_values({key: rig.value(key) * share**power for key, power in powers.items()})


@pytest.fixture(scope="module")
def built_in() -> bytes:
    """The map in the firmware's image."""
    return map_in_flash(elf())


@pytest.fixture(scope="module")
def higher(built_in: bytes) -> bytes:
    """The map with higher stop currents and a higher level of the run-up."""
    members = members_of(built_in)
    changed = {"stop_a_q8": members["stop_a_q8"] + 128, "run_20mv": members["run_20mv"] + 20}
    return maps.flash_bytes({**members, **changed})


def members_of(image: bytes) -> dict[str, np.ndarray]:
    """The members of a map from its bytes."""
    found, at = {}, 0
    for name, kind in maps.MEMBER_TYPES.items():
        count = 1 if name == "run_20mv" else torque_map.ROWS
        found[name] = np.frombuffer(image, kind, count, at)
        at += found[name].nbytes
    assert at == len(image)
    return found


def soft_drive(torque_map: bytes | None = None, **options: object) -> bytes:
    """What the board sends while it tightens a soft joint to 45 N m."""
    load = {**reference("hard_joint").load, "slip_slope_nm_per_rad": 60.0}
    run = sil_run(
        reference(load),
        mode="torque",
        params={"torque_target_nm": 45.0},
        profile=pull(),
        duration_s=1.3,
        torque_map=torque_map,
        **options,
    )
    return run.sent


def test_the_reference_tool_has_the_levels_and_the_parameters_of_the_firmware() -> None:
    rig = reference_rig()
    assert vars(level_scale(rig)) == pytest.approx(vars(SAME), abs=1e-9)
    for name, value in setpoints(rig, SAME).items():
        assert value == pytest.approx(default_value(name), rel=2e-3), name


@pytest.mark.parametrize("share", [0.95, 1.045])
def test_the_levels_of_another_winding_follow_the_law_of_similarity(share: float) -> None:
    rig = other_winding(share)
    found = level_scale(rig, motor_of(rig))
    assert found.level == pytest.approx(share, abs=1.5 * STEP)
    assert found.current == pytest.approx(1.0 / share, rel=0.01)
    assert found.torque == pytest.approx(1.0, abs=0.006)
    values = setpoints(rig, found)
    assert values["sync_low_mv"] == pytest.approx(found.level * 14200, abs=0.5)
    assert values["sync_current_a"] == pytest.approx(25 / share, rel=0.01)
    climb = share * default_value("vibration_climb")
    assert values["vibration_climb"] == pytest.approx(climb, rel=1e-3)
    assert values["motor_mohm"] == round(190 * share**2)


def test_a_tool_of_another_size_is_refused() -> None:
    rig = reference_rig()
    heavy = rig.with_values({"mechanism.spring_preload_n": 1.5 * rig.mechanism["spring_preload_n"]})
    with pytest.raises(VgrooveError, match="levels are not within"):
        level_scale(heavy)


def test_parameters_stay_within_their_ranges() -> None:
    values = setpoints(reference_rig(), dataclasses.replace(SAME, current=3.0, level=3.0))
    assert values["vibration_surge_a"] == 42.0 * 22528 / 21504  # 44 A, the largest
    assert values["sync_high_mv"] == 25000


def test_the_map_in_the_image_is_that_of_the_source(built_in: bytes) -> None:
    members = members_of(built_in)
    assert maps.flash_bytes(members) == built_in
    source = ROOT / "firmware/controllers/torque_map.c"
    assert maps.c_source(members) == source.read_text(encoding="utf-8")


def test_bytes_of_a_map_are_rounded_tables() -> None:
    rows = torque_map.ROWS
    level = np.full(rows, 7.0)
    level[:18] = np.nan
    table = {
        "level": level,
        "settled": np.where(np.isnan(level), np.nan, 14.04),
        "raised": np.full(rows, 8.6),
        "stop": np.full(rows, 16.0),
    }
    found = maps.member_values(table, 5.5)
    assert set(found["level_40mv"][18:]) == {50} and set(found["level_40mv"][:18]) == {0}
    assert set(found["settled_a_q4"][:18]) == {255} and found["settled_a_q4"][18] == 33
    assert (found["raised_40mv"][0], found["stop_a_q8"][0], found["run_20mv"][0]) == (90, 4096, 25)


@pytest.mark.parametrize(
    ("settled", "byte", "warned"),
    [(11.77, 0, True), (11.98, 0, False), (27.875, 254, False), (27.99, 254, True)],
)
def test_a_current_beyond_the_bytes_is_the_nearest_one_and_is_warned_of(
    settled: float, byte: int, warned: bool
) -> None:
    rows = torque_map.ROWS
    table = {name: np.full(rows, 8.0) for name in ("level", "raised")}
    table |= {"settled": np.full(rows, 14.0), "stop": np.full(rows, 16.0)}
    table["settled"][20:23] = settled
    table["level"][:18] = table["settled"][:18] = np.nan  # no joint settles at these targets
    found = maps.member_values(table, 5.5)
    assert set(found["settled_a_q4"][20:23]) == {byte} and found["settled_a_q4"][19] == 32
    warnings = maps.beyond_range(table, 5.5)
    assert len(warnings) == int(warned)
    off_a = abs(settled - np.clip(settled, 12.0, 27.875))
    assert all(text.startswith("targets of 60 to 62 N m") for text in warnings)
    amount = [float(re.search(r"up to (\S+) A", text)[1]) for text in warnings]
    assert amount == pytest.approx([off_a] * len(warnings), abs=1 / 16)


def test_the_targets_of_a_warning_are_those_whose_values_do_not_fit() -> None:
    rows = np.array([2, 20, 21, 22, 60])
    assert maps._targets(rows) == "42 N m, 60 to 62 N m, 100 N m"


def test_a_setpoint_that_the_board_cannot_hold_is_warned_of() -> None:
    needed = needed_setpoints(reference_rig(), SAME)
    assert beyond_range(needed) == []
    [warning] = beyond_range({**needed, "motor_rpm_per_v": 973.0})
    assert warning.startswith("motor_rpm_per_v: this tool needs 973 rpm/V, the nearest value")


@pytest.mark.parametrize("pulses", [0, 5, 6])
def test_hall_edges_that_no_board_reads_are_refused(pulses: int) -> None:
    rig = reference_rig().with_values({"sensors.hall_pulses_per_rev": pulses})
    with pytest.raises(VgrooveError, match="reads 1 to 4 Hall edges a turn"):
        check_tool(rig)


def test_the_duty_that_holds_the_preload_follows_groove_gear_and_supply() -> None:
    for key, factor, share in (
        ("gearbox.ratio", 1.1, 1.0 / 1.1),
        ("mechanism.groove_lead_m_per_rad", 1.1, 1.1),
        ("mechanism.spring_preload_n", 1.1, 1.1),
        ("supply.voltage_v", 0.8, 1.25),
    ):
        rig = reference_rig()
        table, name = key.split(".")
        other = rig.with_values({key: factor * getattr(rig, table)[name]})
        assert climb_share(other) == pytest.approx(share), key


def test_the_check_runs_with_the_parameters_of_the_tool() -> None:
    """Two Hall edges a turn: with the default of four the board counts half the speed."""
    rig = reference_rig().with_values({"sensors.hall_pulses_per_rev": 2})
    values = setpoints(rig, SAME)
    assert values["hall_pulses"] == 2.0
    cell = next(c for c in torque_drawn.cells(1) if c["target_nm"] == 75.0)
    own, plain = (
        torque_drawn.work(torque_drawn.CONTROLLER, base=rig, adapted=adapted, **cell)
        for adapted in (torque_drawn.Adapted(None, values), torque_drawn.Adapted())
    )
    assert abs(own["error"]) < 0.06 and torque_drawn.reached(own)
    assert not torque_drawn.reached(plain) or abs(plain["error"]) > 0.06


def test_what_a_controller_clips_is_warned_of() -> None:
    needed = needed_setpoints(reference_rig(), SAME)
    assert beyond_controllers(needed) == []
    [steep] = beyond_controllers({**needed, "motor_mohm": 600.0, "motor_rpm_per_v": 876.0})[:1]
    assert "loses 526 rpm per A" in steep
    [winding] = beyond_controllers({**needed, "motor_mohm": 520.0})
    assert winding.startswith("motor_mohm: this tool needs 520 mohm")
    [edges] = beyond_controllers({**needed, "hall_pulses": 2})
    assert "5.6 edges from lug to lug" in edges


@pytest.mark.parametrize("scale", [0.91, 1.0, 1.115])
def test_all_levels_of_the_range_fit_into_the_bytes(scale: float) -> None:
    highest = max(v for v, _, _ in torque_map.RAISED_V)
    assert torque_map.levels_of(scale).min() >= torque_map.BASE_V
    for level_v in (torque_map.levels_of(scale).max(), scale * highest):
        assert (level_v - torque_map.BASE_V) / torque_map.LEVEL_STEP_V <= 255
    assert scale * torque_map.RUN_V >= torque_map.BASE_V


def test_only_the_map_changes_in_the_hex_file(
    tmp_path: Path, built_in: bytes, higher: bytes
) -> None:
    built, adapted = tmp_path / "built.hex", tmp_path / "adapted.hex"
    built.write_bytes(adapted_image(elf(), built_in, "hex"))
    adapted.write_bytes(adapted_image(elf(), higher, "hex"))
    assert built.read_bytes() == elf().with_suffix(".hex").read_bytes()
    before, after = hex_bytes(built), hex_bytes(adapted)
    changed = [address for address in before if before[address] != after[address]]
    assert len(before) == len(after) and changed
    assert max(changed) - min(changed) < len(built_in)


def test_the_adapted_image_drives_as_the_native_firmware_with_that_map(
    tmp_path: Path, higher: bytes
) -> None:
    image = tmp_path / "adapted.elf"
    image.write_bytes(adapted_image(elf(), higher, "elf"))

    def board(eeprom: bytes) -> AvrBoard:
        path = tmp_path / "eeprom.bin"
        path.write_bytes(eeprom)
        return AvrBoard(image, eeprom=path)

    native, avr = soft_drive(higher), soft_drive(board=board)
    rows = [telemetry.Session() for _ in range(2)]
    for session, sent in zip(rows, (native, avr), strict=True):
        session.feed(telemetry.Framer().feed(sent))
    own, other = (session.take_rows() for session in rows)
    count = min(len(own["duty"]), len(other["duty"]))
    assert count > 1000 and np.array_equal(own["duty"][:count], other["duty"][:count])


def test_a_replaced_map_acts_and_ends_with_its_run(built_in: bytes, higher: bytes) -> None:
    before = soft_drive()
    assert soft_drive(higher) != before
    assert soft_drive() == before
    assert soft_drive(built_in) == before


def test_a_map_of_another_size_is_refused(built_in: bytes) -> None:
    with pytest.raises(ValueError, match="a torque map has 406 bytes"):
        soft_drive(built_in[:-1])
    with pytest.raises(VgrooveError, match="406 bytes, not 405"):
        adapted_image(elf(), built_in[:-1], "hex")


def test_the_firmware_of_a_drill_driver_has_no_map() -> None:
    with pytest.raises(VgrooveError, match="without torque control"):
        map_in_flash(ROOT / "build/avr-uno-drill/vgroove.elf")


def test_cells_of_the_three_strata_are_the_same_drives() -> None:
    found = torque_adapted.cells()
    by_stratum = [[c for c in found if c["stratum"] == s] for s in torque_adapted.STRATA]
    assert len({len(cells) for cells in by_stratum}) == 1
    for nominal, unadapted, adapted in zip(*by_stratum, strict=True):
        assert nominal["tool"] == {} and unadapted["tool"] == adapted["tool"] != {}
        for key in set(nominal) - {"stratum", "tool"}:
            assert nominal[key] == unadapted[key] == adapted[key]
    for half in ("tune", "report"):
        targets = [c["target_nm"] for c in found if (c["set"], c["stratum"]) == (half, NOMINAL)]
        assert sorted(targets) == sorted(2 * list(map(float, torque_drawn.TARGETS_NM)))
        assert len(torque_adapted.map_jobs([c for c in found if c["set"] == half])) == 18
    assert not any(a in torque_adapted.tools("report") for a in torque_adapted.tools("tune"))


def test_the_check_of_the_built_in_map_with_itself_shows_no_difference(built_in: bytes) -> None:
    same = Adaptation(SAME, SAME, {}, members_of(built_in))
    first, second = check(reference_rig(), same, 2, lambda _: None)
    assert {**first, "variant": ""} == {**second, "variant": ""} and first["runs"] == 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((str(ROOT / "rigs/impact_driver_18v.toml"),), "this needs .mechanism. kind = .impact."),
        ((str(REFERENCE), "-o", "map.bin"), "-o ends in .hex or .elf"),
        ((str(REFERENCE), "--target", "nano"), "--target is uno or mega"),
        ((str(REFERENCE), "-o", str(REFERENCE)), "impact_driver.toml"),
    ],
)
def test_unusable_arguments_are_refused_in_a_sentence(
    arguments: tuple[str, ...], message: str
) -> None:
    with pytest.raises(VgrooveError, match=message):
        CliRunner().invoke(app, ["adapt", *arguments], catch_exceptions=False)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--port", "/dev/none"), "/dev/none: the port cannot be opened"),
        (("--port", "foo://x"), "foo://x: the port cannot be opened"),
        (("--port", "/dev/none", "--baud", "5"), "--baud is 250000 or 115200, .* not 5"),
    ],
)
def test_an_unusable_port_is_refused_before_the_work(
    options: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def begun(*_: object) -> None:
        raise AssertionError("the torque map is computed first")

    monkeypatch.setattr(adaptation, "adapt", begun)
    with pytest.raises(VgrooveError, match=message):
        CliRunner().invoke(app, ["adapt", str(REFERENCE), *options], catch_exceptions=False)


def test_a_port_on_which_no_board_sends_is_refused_and_one_with_a_board_is_free_after(
    tmp_path: Path,
) -> None:
    near, far = os.openpty()
    with pytest.raises(VgrooveError, match="no frame of a vgroove board within 3 s"):
        check_board(os.ttyname(far), 250_000)
    os.close(near)
    os.close(far)
    process, port = start_on_pty("sil", scenario_with(tmp_path, "[[0.0, 0.0]]"), "--real-time")
    try:
        check_board(port, 250_000)
        write_parameters(port, {"sync_low_mv": 14000.0})
    finally:
        process.kill()
        process.wait()


def scenario_with(folder: Path, travel: str) -> Path:
    """A long scenario with another course of the trigger."""
    path = short_scenario(folder, 60.0)
    pulled = "travel = [[0.0, 0.0], [0.3, 0.0], [0.5, 1.0], [2.0, 1.0], [2.1, 0.0]]"
    assert pulled in path.read_text()
    path.write_text(path.read_text().replace(pulled, f"travel = {travel}"))
    return path


def test_parameters_reach_the_eeprom_of_a_board(tmp_path: Path) -> None:
    process, port = start_on_pty("sil", scenario_with(tmp_path, "[[0.0, 0.0]]"), "--real-time")
    values = {"sync_low_mv": 14000.0, "motor_mohm": 181.0, "vibration_climb": 0.25}
    try:
        write_parameters(port, values)
        with ResyncBus(port) as bus:
            session = telemetry.Session()
            bus.write(telemetry.frame_bytes(telemetry.frame_of_signals("DUMP", 0, dump_sequence=9)))
            while session.table is None:
                session.feed(bus.read_frames())
        entries = telemetry.parameter_list()
        found = {entries[index].name: raw for index, raw in session.parameters.items()}
        assert found["sync_low_mv"] == 14000 and found["motor_mohm"] == 181
        assert found["vibration_climb_q15"] == 8192
    finally:
        process.kill()
        process.wait()


class Slowly(dict):
    """Parameters that are written over half a second."""

    def items(self) -> Iterator[tuple[str, float]]:
        """The parameters with a pause before each."""
        for item in super().items():
            time.sleep(0.06)
            yield item


def test_a_driven_tool_keeps_its_parameters(tmp_path: Path) -> None:
    scenario = scenario_with(tmp_path, "[[0.0, 0.0], [0.35, 0.0], [0.4, 1.0]]")
    process, port = start_on_pty("sil", scenario, "--real-time")
    values = Slowly(setpoints(reference_rig(), LevelScale(1.02, 1.0, 1.02, 0.0)))
    try:
        with pytest.raises(VgrooveError, match=r"the tool is driven: .* were not written"):
            write_parameters(port, values)
    finally:
        process.kill()
        process.wait()


def test_a_port_without_a_board_is_named() -> None:
    with pytest.raises(VgrooveError, match="/dev/none"):
        write_parameters("/dev/none", {"sync_low_mv": 14000.0})
