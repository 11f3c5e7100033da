// Fake hardware for unit tests: records what the firmware requests and returns what the test sets.
#ifndef VGROOVE_HAL_NATIVE_H
#define VGROOVE_HAL_NATIVE_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define NATIVE_EEPROM_BYTES 1024u

typedef struct {
    uint8_t eeprom[NATIVE_EEPROM_BYTES];
    uint8_t switches;
    uint8_t reset_cause;
    uint8_t high_below;
    uint8_t low_above;
    bool leg_b_high;
    bool armed;
    bool enabled;
    bool apply_later;
    bool eeprom_busy;
    uint8_t baud;
    uint16_t stack_free;
    uint16_t tick_cycles;
    uint32_t opened;  // number of calls
    bool receive_off;
    uint32_t woken;
    uint32_t eeprom_writes;
    int32_t locks;  // hal_lock() less hal_unlock()
} Native;

extern Native native;

void native_reset(void);

#ifdef __cplusplus
}
#endif

#endif
