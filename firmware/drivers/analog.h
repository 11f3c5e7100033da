// Bus voltage and bridge temperature from ADC counts.
#ifndef VGROOVE_DRIVERS_ANALOG_H
#define VGROOVE_DRIVERS_ANALOG_H

#include <stdbool.h>
#include <stdint.h>

#define ANALOG_TEMPERATURE_COUNTS_MIN 20u  // TMP36: 100 mV at -40 C, its lower limit
#define ANALOG_TEMPERATURE_COUNTS_MAX 1003u

uint16_t analog_supply_mv(uint16_t counts, int16_t gain_mv_q8);

// Telemetry counts of 25 mV; sets `*saturated` above 10 bits.
uint16_t analog_supply_25mv(uint16_t supply_mv, bool *saturated);

// TMP36 (Analog Devices, rev. H): 500 mV at 0 C, 10 mV/C; 5 V reference.
int16_t analog_temperature_c_q4(uint16_t counts);
bool analog_temperature_plausible(uint16_t counts);

#endif
