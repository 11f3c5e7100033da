// Parameters: range-checked values in RAM, saved in two EEPROM slots of which one is always intact.
//
// A slot holds version, count, generation (uint16 LE), values (int16 LE) and a CRC-16 over all
// bytes before it. A save writes the slot that does not hold the newest set: first the version
// byte 0xFF, which no set has, then the rest, finally the version. If the power fails at any byte,
// whatever that byte then reads, the slot is either void or complete, and the other slot is
// unchanged.
#ifndef VGROOVE_APP_PARAM_STORE_H
#define VGROOVE_APP_PARAM_STORE_H

#include <stdbool.h>
#include <stdint.h>

#include "app/param_table.h"

// Fixed for all versions; bytes 0..15 are unused, since a write by mistake hits address 0 most
// often.
#define PARAM_SLOT_ADDRESS 16u
#define PARAM_SLOT_STRIDE 256u
#define PARAM_SLOTS 2u
#define PARAM_SLOT_NONE 0xFFu

#define PARAM_ENUMERATOR(name, unit, initial, least, greatest, version) PARAM_##name,
typedef enum { PARAM_LIST(PARAM_ENUMERATOR) PARAM_COUNT } ParamIndex;

// Values of signal table_status.
typedef enum {
    PARAM_LOADED,
    PARAM_BLANK,            // both slots erased: defaults
    PARAM_MIGRATED,         // an older version was loaded, newer parameters have their defaults
    PARAM_UNKNOWN_VERSION,  // the newest set is of a version that this firmware does not know:
                            // defaults
    PARAM_CORRUPT,          // no slot is whole and not both are erased: defaults
    PARAM_REPAIRED,         // a loaded value was out of range and has its default
} ParamStatus;

typedef struct {
    int16_t value[PARAM_COUNT];
    uint16_t generation;  // of the set in `slot`
    uint16_t crc16;       // of the bytes written so far
    uint8_t slot;         // of the newest set, or PARAM_SLOT_NONE
    uint8_t step;         // next step of the save in progress, 0: none
    uint8_t status;       // ParamStatus
} ParamStore;

// Loads the newest intact set. The EEPROM must be ready.
void param_load(ParamStore *self);

// Sets a value and saves the set; false and no change when it is out of range. Restarts a save in
// progress.
bool param_set(ParamStore *self, ParamIndex index, int32_t value);

// Sets a value without saving it: valid until the next start, unless param_set() saves the set.
bool param_try(ParamStore *self, ParamIndex index, int32_t value);

// Whether a byte is left to be written and the EEPROM is ready for it.
bool param_due(const ParamStore *self);

// Writes the next byte when it is due; once a tick.
void param_step(ParamStore *self);

bool param_saving(const ParamStore *self);

#endif
