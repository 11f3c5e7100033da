// Parameters: range-checked values in RAM, kept in two EEPROM slots of which one is always whole.
//
// A slot is version, count, generation (uint16 LE), values (int16 LE), CRC-16 over all before it. A
// write goes to the slot that does not hold the newest set: first its version becomes 0xFF, which
// no set has, then the rest is written, last the version. Whatever byte the power fails at, and
// whatever that byte then reads, the slot is either void or complete, and the other one has not
// been touched.
#ifndef VGROOVE_APP_PARAM_STORE_H
#define VGROOVE_APP_PARAM_STORE_H

#include <stdbool.h>
#include <stdint.h>

#include "app/param_table.h"

// Slots stand where every version finds them; the first bytes stay unused, since address 0 is what
// a stray write hits most often.
#define PARAM_SLOT_ADDRESS 16u
#define PARAM_SLOT_STRIDE 256u
#define PARAM_SLOTS 2u
#define PARAM_SLOT_NONE 0xFFu

#define PARAM_ENUMERATOR(name, unit, initial, least, greatest, version) PARAM_##name,
typedef enum { PARAM_LIST(PARAM_ENUMERATOR) PARAM_COUNT } ParamIndex;

// TELEMETRY_TABLE_STATUS_* says the same on the wire.
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
    uint16_t crc16;       // of what has been written of the new set
    uint8_t slot;         // holds the newest set, PARAM_SLOT_NONE: none does
    uint8_t step;         // next byte of the write in progress, 0: none
    uint8_t status;       // ParamStatus
} ParamStore;

// Loads the newest whole set. The EEPROM must be ready.
void param_load(ParamStore *self);

// Sets a value and saves the set; false and no change when it is out of range. A save in progress
// starts over.
bool param_set(ParamStore *self, ParamIndex index, int32_t value);

// The same without saving it: it holds until the next start, unless the set is saved for another's
// sake.
bool param_try(ParamStore *self, ParamIndex index, int32_t value);

// A byte waits to be written, and the EEPROM is ready for it.
bool param_due(const ParamStore *self);

// Writes the next byte when it is due; once a tick.
void param_step(ParamStore *self);

bool param_saving(const ParamStore *self);

#endif
