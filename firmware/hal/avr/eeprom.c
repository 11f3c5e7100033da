// EEPROM, one byte at a time, without waiting for a write to end.
#include "hal/eeprom.h"

#include <avr/io.h>

#include "hal/hal.h"

bool hal_eeprom_ready(void) {
    return (EECR & (1u << EEPE)) == 0u;
}

uint8_t hal_eeprom_read(uint16_t address) {
    EEAR = address;
    EECR = (uint8_t)(EECR | (1u << EERE));
    return EEDR;
}

// EEPE must follow EEMPE within four cycles (data sheet, "The EEPROM Control Register").
void hal_eeprom_start_write(uint16_t address, uint8_t value) {
    const uint8_t lock = hal_lock();
    EECR = 0;
    EEAR = address;
    EEDR = value;
    EECR |= 1u << EEMPE;
    EECR |= 1u << EEPE;
    hal_unlock(lock);
}
