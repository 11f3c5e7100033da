// Constant tables in flash, where they cost no RAM on the AVR; plain constants on the host.
// FLASH_CONST in place of const: a table that the one of another tool may replace, on the AVR in
// the image of the flash, on the host in memory.
#ifndef VGROOVE_CORE_FLASH_H
#define VGROOVE_CORE_FLASH_H

#include <stdint.h>

#ifdef __AVR__
#include <avr/pgmspace.h>
#define FLASH_TABLE PROGMEM
#define FLASH_CONST const
#define FLASH_PAGE                                                                                 \
    __attribute__((                                                                                \
        aligned(256)))  // a table of 256 bytes whose index is the low byte of its address
#define FLASH_U8(place) pgm_read_byte(place)
#define FLASH_I16(place) ((int16_t)pgm_read_word(place))
#else
#define FLASH_TABLE
#define FLASH_CONST
#define FLASH_PAGE
#define FLASH_U8(place) (*(const uint8_t *)(place))
#define FLASH_I16(place) (*(const int16_t *)(place))
#endif

#endif
