// The native firmware in lock-step with a tool: one call simulates one PWM period of 510 CPU cycles
// (docs/architecture.md).
//
// The firmware's interrupt handlers are called at the cycles at which the hardware of the ATmega
// raises them. One instance per process; sim_reset() starts another run with a new state.
#ifndef VGROOVE_HAL_SIM_SIM_H
#define VGROOVE_HAL_SIM_SIM_H

#include <stdint.h>

#include "hal/sim/sim_io.h"

#ifdef __cplusplus
extern "C" {
#endif

#define SIM_EEPROM_BYTES 1024u
#define SIM_TORQUE_MAP_BYTES 406u  // of TorqueMap
#define SIM_RESET_POWER_ON 1u
#define SIM_TARGET_NATIVE 0u

// Initial conditions of a run. The latencies change when code runs, not what it computes: tests
// vary them.
typedef struct {
    const uint8_t *eeprom;      // SIM_EEPROM_BYTES, NULL: erased
    uint8_t reset_cause;        // bit 0 power-on, 1 external, 2 brown-out, 3 watchdog
    uint8_t target;             // what BOOT reports: TELEMETRY_TARGET_*
    uint16_t isr_cycles;        // from interrupt to its code, at most 300
    uint16_t tick_cycles;       // from tick to the start of app_tick, 260 .. 8,000
    const uint8_t *torque_map;  // SIM_TORQUE_MAP_BYTES, NULL: the one in the source
    uint32_t start_ms;          // the telemetry's time at the start
} SimStart;

// Default latencies. An ADC result comes 54 cycles before the end of a period; with an interrupt
// latency above that an over-current opens the bridge in the next period, as on the AVR.
#define SIM_ISR_CYCLES 80u
#define SIM_TICK_CYCLES 400u
#define SIM_START_DEFAULT                                                                          \
    { 0, SIM_RESET_POWER_ON, SIM_TARGET_NATIVE, SIM_ISR_CYCLES, SIM_TICK_CYCLES, 0, 0 }

// Period 0 begins at the first TOP after the start of the timers; `outputs` apply to it.
void sim_reset(const SimStart *start, SimOutputs *outputs);
void sim_period(const SimInputs *inputs, SimOutputs *outputs);

// Present EEPROM contents, SIM_EEPROM_BYTES.
const uint8_t *sim_eeprom(void);

// A detected blow, for benches: telemetry sends the count only.
typedef struct {
    uint32_t time_ms;  // of the tick
    uint8_t lugs, repeats;
    uint16_t period_q4, mean_period_q7;  // the running means are those before the blow
    int16_t spread_q15;
} SimBlow;

#define SIM_BLOWS_MAX 4096u  // later ones are dropped

// Blows since sim_reset(); returns their number.
uint16_t sim_blows(const SimBlow **blows);

#define SIM_STAMPS_MAX 4u     // of the Hall edges of a tick; later ones are dropped
#define SIM_TICKS_MAX 65535u  // later ones are dropped
#define SIM_SETPOINTS 10u

// What filters and controller have taken and given in a tick, for the comparison with floating
// point (docs/fixed_point.md).
typedef struct __attribute__((packed)) {
    uint32_t time_ms;
    uint16_t stamps[SIM_STAMPS_MAX];
    uint16_t current_sum, current_offset_q4, current_gain_a_q15;
    uint8_t stamp_count, current_count;
    int16_t current_a_q9, speed_rpm_q1;  // measured
    uint8_t controlled;                  // the controller has made a step
    uint8_t mode, state, stop_reason;
    int16_t travel_q15, in_speed_rpm_q1, in_current_a_q9, duty_q15, trigger_q15;
    uint16_t supply_mv;
    uint8_t coasted, edges;
    int16_t requested_q15, estimate;
    uint16_t blow_count;
    int16_t set[SIM_SETPOINTS];
    uint16_t blow_set[4];
} SimTick;

// Ticks since sim_reset(); returns their number.
uint16_t sim_ticks(const SimTick **ticks);

// Periods simulated since sim_reset(), and cycles from the start of the timers to the beginning of
// the next period.
uint32_t sim_periods(void);
uint64_t sim_cycles(void);

#ifdef __cplusplus
}
#endif

#endif
