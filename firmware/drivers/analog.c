// Slow analogue quantities, see analog.h.
#include "drivers/analog.h"

#include "core/fixed.h"

#define SUPPLY_25MV_MAX 1023u
#define SUPPLY_LAST_MV (25u * SUPPLY_25MV_MAX + 12u)
#define TEMPERATURE_ZERO_Q4 800  // 50 C

uint16_t analog_supply_mv(uint16_t counts, int16_t gain_mv_q8) {
    return (uint16_t)(((uint32_t)counts * (uint16_t)gain_mv_q8 + 0x80u) >> 8);
}

uint16_t analog_supply_25mv(uint16_t supply_mv, bool *saturated) {
    if (supply_mv > SUPPLY_LAST_MV) {
        *saturated = true;
        return SUPPLY_25MV_MAX;
    }
    uint16_t high = (uint16_t)(((uint32_t)(uint16_t)(supply_mv + 12u) * 10486u) >> 16);
    FIXED_HIDE(high);
    return high >> 2;  // * 10486 / 2^18 divides by 25, exact below 43,690
}

int16_t analog_temperature_c_q4(uint16_t counts) {
    // 5 V / 1024 / 10 mV/C * 16 = 7.8125 = 7 + 13 / 16, in 16 bits
    return (int16_t)((int16_t)(7u * counts + fixed_sixteenth((uint16_t)(13u * counts + 8u))) -
                     TEMPERATURE_ZERO_Q4);
}

bool analog_temperature_plausible(uint16_t counts) {
    return counts >= ANALOG_TEMPERATURE_COUNTS_MIN && counts <= ANALOG_TEMPERATURE_COUNTS_MAX;
}
