// CRC-8 by a table of half bytes (16 B of flash, two look-ups a byte), CRC-16 by shifts.
#include "core/crc.h"

#include "core/flash.h"

// crc8_half[n] = n * x^8 modulo x^8 + x^5 + x^3 + x^2 + x + 1
static const uint8_t crc8_half[16] FLASH_TABLE = {
    0x00, 0x2F, 0x5E, 0x71, 0xBC, 0x93, 0xE2, 0xCD, 0x57, 0x78, 0x09, 0x26, 0xEB, 0xC4, 0xB5, 0x9A,
};

uint8_t crc8_next(uint8_t crc, uint8_t byte) {
    crc = (uint8_t)(crc ^ byte);
    crc = (uint8_t)((uint8_t)(crc << 4) ^ FLASH_U8(&crc8_half[crc >> 4]));
    return (uint8_t)((uint8_t)(crc << 4) ^ FLASH_U8(&crc8_half[crc >> 4]));
}

uint16_t crc16_next(uint16_t crc, uint8_t byte) {
    crc = (uint16_t)((uint16_t)(crc >> 8) | (uint16_t)(crc << 8));
    crc = (uint16_t)(crc ^ byte);
    crc = (uint16_t)(crc ^ ((crc & 0xFFu) >> 4));
    crc = (uint16_t)(crc ^ (uint16_t)(crc << 12));
    return (uint16_t)(crc ^ (uint16_t)((crc & 0xFFu) << 5));
}
