"""The parameter store of the firmware: ranges, two slots, migration, and a power failure at every
byte of a save.
"""

import ctypes
import re
import struct

import pytest

from telemetry_board import EEPROM_BYTES, ROOT, Board, Store, eeprom_get, eeprom_set, library
from vgroove import telemetry

SLOTS = (16, 16 + 256)
BLANK = b"\xff" * EEPROM_BYTES
LIST = telemetry.parameter_list()
DEFAULTS = [p.default for p in LIST]
LOADED, IS_BLANK, MIGRATED, UNKNOWN_VERSION, CORRUPT, REPAIRED = range(6)
NEWEST = max(p.version for p in LIST)


def load() -> Store:
    store = Store()
    library().param_load(ctypes.byref(store))
    return store


def values(store: Store) -> list[int]:
    return list(store.value)


def save(store: Store, index: int, value: int, steps: int = 10_000) -> bool:
    """Set one parameter and step until the save is complete; False when the value was refused."""
    if not library().param_set(ctypes.byref(store), index, ctypes.c_int32(value)):
        return False
    for _ in range(steps):
        if not library().param_saving(ctypes.byref(store)):
            break
        library().param_step(ctypes.byref(store))
    return True


def slot_image(version: int, generation: int, content: list[int]) -> bytes:
    """A slot in the layout of docs/telemetry.md, made without the firmware."""
    body = struct.pack(f"<BBH{len(content)}h", version, len(content), generation, *content)
    return body + struct.pack("<H", telemetry.crc16(body))


def eeprom_with(*images: tuple[int, bytes]) -> bytes:
    content = bytearray(BLANK)
    for slot, image in images:
        content[SLOTS[slot] : SLOTS[slot] + len(image)] = image
    return bytes(content)


@pytest.fixture(autouse=True)
def _blank() -> None:
    library().shim_eeprom_busy(ctypes.c_uint8(0))
    eeprom_set()


def test_a_blank_eeprom_gives_the_defaults() -> None:
    store = load()
    assert values(store) == DEFAULTS and store.status == IS_BLANK and store.slot == 255


@pytest.mark.parametrize("index", range(len(LIST)))
def test_each_parameter_takes_its_limits_and_nothing_beyond(index: int) -> None:
    p, store = LIST[index], load()
    for value, fits in (
        (p.minimum, True),
        (p.maximum, True),
        (p.minimum - 1, False),
        (p.maximum + 1, False),
        (p.minimum + 65536, False),
    ):
        before = values(store)
        assert save(store, index, value) == fits
        assert values(store)[index] == (value if fits else before[index])
    assert values(load())[index] == p.maximum


def test_an_index_beyond_the_list_is_refused() -> None:
    store = load()
    assert not save(store, len(LIST), 0) and not save(store, 255, 0) and values(store) == DEFAULTS


def test_saves_alternate_between_the_slots_and_the_newest_is_loaded() -> None:
    store = load()
    for k, value in enumerate((600, 601, 602, 603)):
        assert save(store, 12, value)
        assert (
            store.slot == k % 2
            and load().slot == k % 2
            and values(load())[12] == value
            and load().status == LOADED
        )


def test_what_is_written_is_the_documented_layout() -> None:
    store = load()
    save(store, 12, 600)
    content = [*DEFAULTS]
    content[12] = 600
    assert eeprom_get() == eeprom_with((0, slot_image(NEWEST, 1, content)))


def test_the_generation_counts_on_past_its_wrap() -> None:
    old, new = [*DEFAULTS], [*DEFAULTS]
    old[12], new[12] = 700, 800
    eeprom_set(eeprom_with((0, slot_image(NEWEST, 65535, old)), (1, slot_image(NEWEST, 0, new))))
    assert values(load())[12] == 800
    eeprom_set(eeprom_with((1, slot_image(NEWEST, 65535, old)), (0, slot_image(NEWEST, 0, new))))
    assert values(load())[12] == 800


def test_one_byte_at_a_time_and_only_when_the_eeprom_is_ready() -> None:
    lib, store = library(), load()
    lib.shim_eeprom_busy(ctypes.c_uint8(4))
    lib.param_set(ctypes.byref(store), 12, ctypes.c_int32(600))
    for _ in range(2000):
        before = lib.shim_eeprom_writes()
        lib.param_step(ctypes.byref(store))
        assert lib.shim_eeprom_writes() - before <= 1
    assert not lib.param_saving(ctypes.byref(store)) and values(load())[12] == 600


def test_a_change_during_a_save_is_in_the_set_that_is_saved() -> None:
    lib, store = library(), load()
    for steps in range(1, 60):
        eeprom_set()
        store = load()
        lib.param_set(ctypes.byref(store), 12, ctypes.c_int32(600))
        for _ in range(steps):
            lib.param_step(ctypes.byref(store))
        assert save(store, 3, 9000)
        loaded = load()
        assert (values(loaded)[12], values(loaded)[3], loaded.status) == (600, 9000, LOADED), steps


def prepared(kind: str) -> bytes:
    """EEPROM before the interrupted save: never written, written once, written twice, or with an
    older list version in both slots.
    """
    old = [*DEFAULTS]
    old[12] = 700
    one = slot_image(
        NEWEST, 8, [700 if k == 12 else p.default + (k == 13) for k, p in enumerate(LIST)]
    )
    first = slot_image(1, 9, [p.default for p in LIST if p.version == 1])
    return {
        "blank": BLANK,
        "one slot": eeprom_with((0, slot_image(NEWEST, 9, old))),
        "both slots": eeprom_with((0, slot_image(NEWEST, 9, old)), (1, one)),
        "older version": eeprom_with(
            (0, first), (1, slot_image(1, 8, [p.default for p in LIST if p.version == 1]))
        ),
    }[kind]


@pytest.mark.parametrize("kind", ["blank", "one slot", "both slots", "older version"])
def test_a_power_failure_at_any_byte_with_any_garbage_loses_neither_set(kind: str) -> None:
    lib, before = library(), prepared(kind)
    eeprom_set(before)
    store = load()
    old = values(store)
    save(store, 12, 1234)
    writes, new = lib.shim_eeprom_writes(), values(store)
    assert writes >= 6 and old != new
    for write in range(1, writes + 1):
        for garbage in range(256):
            eeprom_set(before)
            store = load()
            lib.shim_eeprom_fail_at(write, ctypes.c_uint8(garbage))
            save(store, 12, 1234)
            lib.shim_eeprom_fail_at(0, ctypes.c_uint8(0))
            after = load()
            assert values(after) in (old, new), (write, garbage)
            assert after.status != UNKNOWN_VERSION, (write, garbage)
            if write < writes:
                assert values(after) == old, (write, garbage)


def test_a_slot_is_void_from_the_first_byte_of_a_save_to_the_last() -> None:
    lib, before = library(), prepared("both slots")
    eeprom_set(before)
    store = load()
    save(store, 12, 1234)
    writes = lib.shim_eeprom_writes()
    for write in range(2, writes + 1):
        eeprom_set(before)
        store = load()
        lib.shim_eeprom_fail_at(write, ctypes.c_uint8(0xFF))
        save(store, 12, 1234)
        assert eeprom_get()[SLOTS[1]] == 0xFF, write


def test_a_void_slot_is_not_loaded_whatever_its_crc() -> None:
    eeprom_set(
        eeprom_with((0, slot_image(NEWEST, 4, DEFAULTS)), (1, slot_image(0xFF, 5, DEFAULTS)))
    )
    assert load().status == LOADED and load().slot == 0


def test_after_a_torn_save_the_next_one_succeeds() -> None:
    lib, before = library(), prepared("both slots")
    for write in range(1, 8):
        eeprom_set(before)
        store = load()
        lib.shim_eeprom_fail_at(write, ctypes.c_uint8(0x5A))
        save(store, 12, 1234)
        lib.shim_eeprom_fail_at(0, ctypes.c_uint8(0))
        store = load()
        assert save(store, 12, 2345) and values(load())[12] == 2345 and load().status == LOADED


def test_an_older_version_is_migrated_and_new_parameters_take_their_defaults() -> None:
    first = [p.minimum for p in LIST if p.version == 1]
    assert 0 < len(first) < len(LIST)
    eeprom_set(eeprom_with((1, slot_image(1, 3, first))))
    store = load()
    assert values(store) == first + DEFAULTS[len(first) :] and store.status == MIGRATED
    save(store, 12, 600)
    assert load().status == LOADED and load().slot == 0 and values(load())[:12] == first[:12]


def test_an_unknown_version_is_refused_with_defaults_and_kept_until_the_next_save() -> None:
    known = [*DEFAULTS]
    known[12] = 700
    content = eeprom_with(
        (0, slot_image(NEWEST, 4, known)), (1, slot_image(NEWEST + 1, 5, [1] * 30))
    )
    eeprom_set(content)
    store = load()
    assert values(store) == DEFAULTS and store.status == UNKNOWN_VERSION and eeprom_get() == content
    save(store, 12, 600)
    assert values(load())[12] == 600 and load().status == LOADED
    assert eeprom_get()[SLOTS[1] :] == content[SLOTS[1] :]


@pytest.mark.parametrize("position", range(4 + 2 * len(LIST) + 2))
def test_a_changed_byte_voids_its_slot(position: int) -> None:
    image = bytearray(slot_image(NEWEST, 5, DEFAULTS))
    image[position] ^= 0x10
    eeprom_set(
        eeprom_with(
            (0, bytes(image)),
            (1, slot_image(NEWEST, 4, [700 if k == 12 else d for k, d in enumerate(DEFAULTS)])),
        )
    )
    assert values(load())[12] == 700 and load().status == LOADED
    eeprom_set(eeprom_with((0, bytes(image))))
    assert values(load()) == DEFAULTS and load().status == CORRUPT


def test_a_stored_value_out_of_range_is_replaced_and_reported() -> None:
    content = [*DEFAULTS]
    content[12], content[7] = 5001, 20000
    eeprom_set(eeprom_with((0, slot_image(NEWEST, 5, content))))
    store = load()
    assert (
        values(store)[12] == DEFAULTS[12] and values(store)[7] == 20000 and store.status == REPAIRED
    )


def test_a_board_reports_where_its_parameters_came_from() -> None:
    eeprom_set(
        eeprom_with(
            (1, slot_image(NEWEST, 5, [900 if k == 12 else d for k, d in enumerate(DEFAULTS)]))
        )
    )
    session = telemetry.Session()
    session.feed(telemetry.Framer().feed(Board().run(400)))
    assert (
        session.parameters[12] == 900
        and session.table["table_slot"] == 1
        and session.table["table_status"] == LOADED
    )


def test_status_names_on_the_wire_are_those_of_the_store() -> None:
    choices = (
        telemetry.database()
        .get_message_by_name("PARAM_TABLE")
        .get_signal_by_name("table_status")
        .choices
    )
    enumeration = re.search(
        r"typedef enum \{\n(.*?)\} ParamStatus",
        (ROOT / "firmware/app/param_store.h").read_text(),
        re.DOTALL,
    )
    order = [name.lower() for name in re.findall(r"PARAM_(\w+),", enumeration.group(1))]
    assert order
    assert order == [str(choices[k]) for k in range(len(order))]


def test_an_equal_value_writes_no_byte() -> None:
    store = load()
    index = next(n for n, p in enumerate(LIST) if p.name == "stall_ms")
    assert save(store, index, DEFAULTS[index] + 1)
    before = eeprom_get()
    assert library().param_set(ctypes.byref(store), index, ctypes.c_int32(DEFAULTS[index] + 1))
    assert not library().param_saving(ctypes.byref(store))
    assert eeprom_get() == before
    assert save(store, index, DEFAULTS[index]) and eeprom_get() != before
