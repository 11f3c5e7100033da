// Boundary between firmware and hardware: raw counts, cycles, bytes. The linker selects hal/avr,
// hal/sim or hal/native behind it.
#ifndef VGROOVE_HAL_H
#define VGROOVE_HAL_H

#include <stdbool.h>
#include <stdint.h>

#include "hal/eeprom.h"

// Times are CPU cycles since the common start of the timers (docs/firmware.md, "Timing").
#define HAL_CPU_HZ 16000000u
#define HAL_CYCLES_PER_TICK 16000u  // Timer2: tick k at 16,000 (k + 1)
#define HAL_CYCLES_PER_PERIOD 510u  // Timer0: TOP j at 255 + 510 j, BOTTOM in the middle
#define HAL_FIRST_TOP_CYCLES 255u
#define HAL_CYCLES_PER_SAMPLE 2040u    // ADC: every fourth BOTTOM, first at 510
#define HAL_FIRST_SAMPLE_CYCLES 2241u  // first result: 13.5 ADC clocks of 128 cycles, 3 to start
#define HAL_LATENCY_CYCLES 319u        // a tick uses results that are at least this old
#define HAL_APPLY_LATER_CYCLES 256u    // second compare of Timer2 after the tick

// Compare values are written at least this long before the TOP that latches them.
#define HAL_APPLY_MARGIN_CYCLES 250u
#define HAL_COMPARE_MAX 255

enum {
    HAL_ADC_CURRENT,
    HAL_ADC_BUS,
    HAL_ADC_TRIGGER,
    HAL_ADC_TEMPERATURE,
};

enum {
    HAL_SWITCH_CONTACT = 1,
    HAL_SWITCH_REVERSE = 2,
    HAL_SWITCH_MODE_SHIFT = 2,
};

enum {
    HAL_BAUD_250000,
    HAL_BAUD_115200,
};

// Leg A is the PWM leg (Timer0); leg B is low (forward) or high (reverse).

// All gates off, at once.
void hal_bridge_cut(void);

// The same, and prepares leg A to be off when it is armed.
void hal_bridge_open(void);

// From open only: selects leg B and connects leg A, which is off; the driver is disabled.
void hal_bridge_arm(bool leg_b_high);

// From armed on: compare values of leg A, latched at TOP; enables the driver.
void hal_bridge_set(uint8_t high_below, uint8_t low_above);

// When app_on_apply() runs: at the next tick, or HAL_APPLY_LATER_CYCLES after it.
void hal_apply_at(bool later);

uint8_t hal_switches(void);  // HAL_SWITCH_*, closed = 1
void hal_uart_start(uint8_t baud);
void hal_uart_wake(void);                       // bytes are in the transmit ring
void hal_uart_receive(bool on);                 // off: bytes are lost; on: with the next byte
uint16_t hal_tick_cycles(uint16_t tick_stamp);  // cycles since the tick
uint16_t hal_stack_free(void);                  // bytes that the stack has never used
uint8_t hal_reset_cause(void);     // bit 0 power-on, 1 external, 2 brown-out, 3 watchdog
uint8_t hal_target(void);          // TELEMETRY_TARGET_*
void hal_mark_control(bool runs);  // for the bench: controller step begins or ends
uint8_t hal_lock(void);            // interrupts off; returns the state for hal_unlock
void hal_unlock(uint8_t before);

#endif
