// EEPROM, part of the hardware boundary, one byte at a time: a write takes 3.4 ms, during which
// nothing else can be read or written.
#ifndef VGROOVE_HAL_EEPROM_H
#define VGROOVE_HAL_EEPROM_H

#include <stdbool.h>
#include <stdint.h>

bool hal_eeprom_ready(void);
uint8_t hal_eeprom_read(uint16_t address);
void hal_eeprom_start_write(uint16_t address, uint8_t value);

#endif
