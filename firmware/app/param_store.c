// EEPROM slots of the parameters, see param_store.h.
#include "app/param_store.h"

#include "core/crc.h"
#include "core/flash.h"
#include "hal/eeprom.h"

#define VERSION_VOID 0xFFu  // also what an erased EEPROM reads
#define COUNT_AT 1u
#define GENERATION_AT 2u
#define VALUES_AT 4u
#define CRC_AT (VALUES_AT + 2u * PARAM_COUNT)
#define SLOT_BYTES (CRC_AT + 2u)

// Steps of a write: the version is voided, then bytes 1..SLOT_BYTES-1, then the version.
#define STEP_VOID 1u
#define STEP_VERSION (SLOT_BYTES + 1u)

_Static_assert(SLOT_BYTES <= PARAM_SLOT_STRIDE && STEP_VERSION <= UINT8_MAX,
               "too many parameters for a slot");

typedef struct {
    int16_t initial;
    int16_t least;
    int16_t greatest;
} Limits;

#define PARAM_LIMITS(name, unit, initial, least, greatest, version)                                \
    {(initial), (least), (greatest)},
static const Limits limits[PARAM_COUNT] FLASH_TABLE = {PARAM_LIST(PARAM_LIMITS)};

// Number of parameters in a set of an older version.
#define PARAM_IN_1(name, unit, initial, least, greatest, version) +((version) <= 1u ? 1u : 0u)
#define PARAM_IN_2(name, unit, initial, least, greatest, version) +((version) <= 2u ? 1u : 0u)
#define PARAM_IN_3(name, unit, initial, least, greatest, version) +((version) <= 3u ? 1u : 0u)
enum {
    COUNT_1 = 0u PARAM_LIST(PARAM_IN_1),
    COUNT_2 = 0u PARAM_LIST(PARAM_IN_2),
    COUNT_3 = 0u PARAM_LIST(PARAM_IN_3)
};
_Static_assert(PARAM_VERSION == 4u, "a count for each older version");

static const uint8_t counts[PARAM_VERSION + 1u] FLASH_TABLE = {0, COUNT_1, COUNT_2, COUNT_3,
                                                               PARAM_COUNT};

// 0 for a version that this firmware does not know.
static uint8_t count_of_version(uint8_t version) {
    return version <= PARAM_VERSION ? FLASH_U8(&counts[version]) : 0u;
}

static uint16_t slot_address(uint8_t slot) {
    return slot == 0u ? PARAM_SLOT_ADDRESS : PARAM_SLOT_ADDRESS + PARAM_SLOT_STRIDE;
}

static uint8_t slot_byte(uint8_t slot, uint16_t at) {
    return hal_eeprom_read((uint16_t)(slot_address(slot) + at));
}

static uint16_t slot_word(uint8_t slot, uint16_t at) {
    return (uint16_t)(slot_byte(slot, at) |
                      (uint16_t)((uint16_t)slot_byte(slot, (uint16_t)(at + 1u)) << 8));
}

// Whether the slot holds a complete set: not void, its length fits into the slot, the CRC is right.
// The version may be unknown.
static bool slot_whole(uint8_t slot) {
    const uint16_t crc_at = (uint16_t)(VALUES_AT + 2u * slot_byte(slot, COUNT_AT));
    uint16_t crc = CRC16_INIT;
    if (slot_byte(slot, 0) == VERSION_VOID || crc_at + 2u > PARAM_SLOT_STRIDE) {
        return false;
    }
    for (uint16_t at = 0; at < crc_at; at++) {
        crc = crc16_next(crc, slot_byte(slot, at));
    }
    return crc == slot_word(slot, crc_at);
}

// An erased EEPROM reads 0xFF everywhere. A slot whose save was interrupted also has the version
// 0xFF (void), but its count byte is not 0xFF.
static bool slot_erased(uint8_t slot) {
    return slot_byte(slot, 0) == VERSION_VOID && slot_byte(slot, COUNT_AT) == UINT8_MAX;
}

static uint8_t newest_slot(void) {
    const bool whole[PARAM_SLOTS] = {slot_whole(0), slot_whole(1)};
    if (whole[0] && whole[1]) {
        const uint16_t ahead =
            (uint16_t)(slot_word(1, GENERATION_AT) - slot_word(0, GENERATION_AT));
        return (uint8_t)(ahead != 0u && ahead < 0x8000u ? 1u : 0u);
    }
    if (whole[0] || whole[1]) {
        return (uint8_t)(whole[0] ? 0u : 1u);
    }
    return PARAM_SLOT_NONE;
}

static bool in_range(uint8_t index, int32_t value) {
    return value >= FLASH_I16(&limits[index].least) && value <= FLASH_I16(&limits[index].greatest);
}

static void take_values(ParamStore *self, uint8_t count) {
    for (uint8_t k = 0; k < count; k++) {
        const int16_t value = (int16_t)slot_word(self->slot, (uint16_t)(VALUES_AT + 2u * k));
        if (in_range(k, value)) {
            self->value[k] = value;
        } else {
            self->status = PARAM_REPAIRED;
        }
    }
}

void param_load(ParamStore *self) {
    self->step = 0;
    self->generation = 0;
    self->slot = newest_slot();
    for (uint8_t k = 0; k < PARAM_COUNT; k++) {
        self->value[k] = FLASH_I16(&limits[k].initial);
    }
    if (self->slot == PARAM_SLOT_NONE) {
        self->status = slot_erased(0) && slot_erased(1) ? PARAM_BLANK : PARAM_CORRUPT;
        return;
    }
    const uint8_t count = count_of_version(slot_byte(self->slot, 0));
    self->generation = slot_word(self->slot, GENERATION_AT);
    if (count == 0u || count != slot_byte(self->slot, COUNT_AT)) {
        self->status = PARAM_UNKNOWN_VERSION;
        return;
    }
    self->status = count == PARAM_COUNT ? PARAM_LOADED : PARAM_MIGRATED;
    take_values(self, count);
}

bool param_try(ParamStore *self, ParamIndex index, int32_t value) {
    if ((uint8_t)index >= PARAM_COUNT || !in_range((uint8_t)index, value)) {
        return false;
    }
    self->value[index] = (int16_t)value;
    return true;
}

bool param_set(ParamStore *self, ParamIndex index, int32_t value) {
    const int16_t before = index < PARAM_COUNT ? self->value[index] : 0;
    const bool taken = param_try(self, index, value);
    if (taken && self->value[index] != before) {
        self->step = STEP_VOID;  // an equal value wears no EEPROM cell
    }
    return taken;
}

bool param_saving(const ParamStore *self) {
    return self->step != 0u;
}

static uint8_t target_slot(const ParamStore *self) {
    return (uint8_t)(self->slot == 0u ? 1u : 0u);
}

// Byte `at` of the new set; the CRC covers the bytes before it.
static uint8_t image_byte(const ParamStore *self, uint16_t at) {
    const uint16_t generation = (uint16_t)(self->generation + 1u);
    const uint8_t shift = (at & 1u) != 0u ? 8u : 0u;
    if (at == 0u) {
        return PARAM_VERSION;
    }
    if (at == COUNT_AT) {
        return PARAM_COUNT;
    }
    if (at < VALUES_AT) {
        return (uint8_t)(generation >> shift);
    }
    if (at < CRC_AT) {
        return (uint8_t)((uint16_t)self->value[(at - VALUES_AT) / 2u] >> shift);
    }
    return (uint8_t)(self->crc16 >> shift);
}

// Starts the write of one byte of the new set unless the EEPROM already holds it.
static void write_byte(const ParamStore *self, uint16_t at, uint8_t byte) {
    if (slot_byte(target_slot(self), at) != byte) {
        hal_eeprom_start_write((uint16_t)(slot_address(target_slot(self)) + at), byte);
    }
}

static void write_step(ParamStore *self) {
    const uint16_t at = (uint16_t)(self->step - 1u);
    uint8_t byte = VERSION_VOID;
    if (self->step == STEP_VOID) {
        self->crc16 = crc16_next(CRC16_INIT, PARAM_VERSION);
    } else if (self->step == STEP_VERSION) {
        byte = PARAM_VERSION;
    } else {
        byte = image_byte(self, at);
        if (at < CRC_AT) {
            self->crc16 = crc16_next(self->crc16, byte);
        }
    }
    self->step++;
    write_byte(self, self->step > STEP_VERSION ? 0u : at, byte);
}

bool param_due(const ParamStore *self) {
    return self->step != 0u && hal_eeprom_ready();
}

void param_step(ParamStore *self) {
    if (!param_due(self)) {
        return;
    }
    if (self->step <= STEP_VERSION) {
        write_step(self);
        return;
    }
    self->slot = target_slot(self);
    self->generation++;
    self->step = 0;
    self->status = PARAM_LOADED;
}
