// Checksums of frames and of stored parameters, a byte at a time.
#ifndef VGROOVE_CORE_CRC_H
#define VGROOVE_CORE_CRC_H

#include <stdint.h>

// AUTOSAR CRC8H2F (specification of CRC routines, 7.2.1.2): polynomial 0x2F, initial value and
// final XOR 0xFF.
#define CRC8_INIT 0xFFu
#define CRC8_FINAL_XOR 0xFFu

// CRC-16 of CCITT: polynomial 0x1021, initial value 0xFFFF.
#define CRC16_INIT 0xFFFFu

uint8_t crc8_next(uint8_t crc, uint8_t byte);
uint8_t crc8_over(uint8_t crc, const uint8_t *bytes, uint8_t count);
uint8_t crc8_over_frame(uint8_t crc, const uint8_t time[4],
                        const uint8_t data[7]);  // the two parts of a frame, one after the other
uint16_t crc16_next(uint16_t crc, uint8_t byte);

#endif
