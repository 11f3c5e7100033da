// Message that board and tool exchange once per PWM period (docs/architecture.md): one packed,
// little-endian struct in each direction.
#ifndef VGROOVE_HAL_SIM_SIM_IO_H
#define VGROOVE_HAL_SIM_SIM_IO_H

#include <stdint.h>

#define SIM_CYCLES_PER_PERIOD 510u
#define SIM_CPU_HZ 16000000u
#define SIM_EDGES_MAX 8u
#define SIM_BYTES_MAX 4u

enum {
    SIM_ADC_CURRENT,
    SIM_ADC_BUS,
    SIM_ADC_TRIGGER,
    SIM_ADC_TEMPERATURE,
    SIM_ADC_CHANNELS,
};

enum {
    SIM_SWITCH_CONTACT = 1,  // trigger contact closed
    SIM_SWITCH_REVERSE = 2,  // direction switch in reverse
    SIM_SWITCH_MODE_0 = 4,
    SIM_SWITCH_MODE_1 = 8,
};

typedef struct __attribute__((packed)) {
    uint16_t adc_counts[SIM_ADC_CHANNELS];  // 10 bits, at the end of the period
    uint16_t edge_cycle[SIM_EDGES_MAX];     // CPU cycle within the period, 0..509, increasing
    uint8_t edge_count;
    uint8_t switches;
    uint8_t rx_count;
    uint8_t rx[SIM_BYTES_MAX];
} SimInputs;

typedef struct __attribute__((packed)) {
    uint8_t coast;        // 1: all gates off in the next period
    int16_t compare;      // signed, -255..255, applied in the next period
    uint8_t dead_counts;  // timer counts in which neither side of leg A is on, around compare
    uint8_t tx_count;
    uint8_t tx[SIM_BYTES_MAX];
} SimOutputs;

#endif
