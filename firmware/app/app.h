// State of the whole firmware, and the entry points that the hardware layer calls: start, tick,
// interrupts.
//
// A tick: read inputs (edges, samples, switches) -> faults -> state machine -> controller ->
// fold-back -> stage the bridge -> commands -> telemetry.
#ifndef VGROOVE_APP_H
#define VGROOVE_APP_H

#include <stdbool.h>
#include <stdint.h>

#include "app/balance.h"
#include "app/control.h"
#include "app/faults.h"
#include "app/measure.h"
#include "app/modes.h"
#include "app/param_store.h"
#include "app/standstill.h"
#include "controllers/foldback.h"
#include "drivers/adc_sequence.h"
#include "drivers/current_sense.h"
#include "drivers/h_bridge.h"
#include "drivers/hall_speed.h"
#include "drivers/trigger.h"
#include "drivers/uart.h"
#include "telemetry/command.h"
#include "telemetry/telemetry.h"

_Static_assert(TELEMETRY_FRAME_BYTES == RING_FRAME, "the UART queues whole frames");

typedef struct {
    AdcSequence adc;  // first: the ADC interrupt reaches it by displacement
    ParamStore params;
    CurrentSense current;
    Trigger trigger;
    HallSpeed hall;
    HBridge bridge;
    Uart uart;
    Measurement measured;
    Faults faults;
    FaultLimits fault_limits;
    Balance balance;
    Standstill standstill;
    Modes modes;
    Control control;
    Foldback foldback;
    CommandParser parser;
    Command command;  // the last one received
    Telemetry telemetry;
    TelemetryInputs report;                   // kept between ticks, since most of it rarely changes
    uint8_t spare[TELEMETRY_TICK_BYTES_MAX];  // receives frames when the UART's queue is full
    uint16_t worst_cycles;                    // longest tick since the last HEALTH frame
    uint16_t kept_flags;                      // flags of the ticks since the last update of STATE
    uint16_t standing_flags;                  // TELEMETRY_FLAGS_* that hold until the next start
    int16_t duty_limit_q15;                   // duty at full trigger, a setpoint
    int16_t ramp_q15;                         // ramped trigger
    int16_t slew_q15;                         // greatest change of ramp_q15 per tick
    int16_t run_down_q15;                     // the same after a release
    int16_t requested_q15;                    // duty that was requested last
    int16_t ramp_duty_q15;      // last duty that drove the shaft, and its speed: a drive that
    int16_t ramp_speed_rpm_q1;  // begins with a turning shaft starts from their ratio
    uint8_t calibration;        // TELEMETRY_CALIBRATE_WHAT_*, CANCEL: none
    uint8_t host_mode;  // of the last SET_MODE, initially the parameter; used while the mode
                        // switch is at position 0
    uint8_t mode;       // TELEMETRY_MODE_*, selected
    bool driving;       // a drive is going on
    bool controlled;    // its controller has been started
    uint16_t calibration_ticks;
    uint16_t trigger_least;  // counts during the calibration of the trigger
    uint16_t trigger_greatest;
    bool save_offset;  // the offset measured at rest is saved as a parameter
    uint8_t overruns;
    uint8_t configuration_step;  // next step of configure.c
    bool calibrated;
    bool hall_taken;       // all Hall pitches learned so far were within their range
    bool command_pending;  // a command waits for its execution and its ACK
    bool heavy;            // the drive used many cycles in this tick
    uint8_t full_ticks;    // consecutive ticks with a heavy drive or two edges, in which
                           // there is no slow work
    bool slow_turn;        // a slow frame had to wait in the last tick: it precedes slow work
} App;

void app_init(App *self, uint32_t build_hash);

// `ticks_late`: number of later ticks that are due as well.
void app_tick(App *self, uint8_t ticks_late);

// Interrupts. app_on_apply(), which applies the staged order to the bridge, has the highest
// priority.
void app_on_tick(App *self);
void app_on_apply(App *self);
void app_on_edge(App *self, uint16_t stamp);
// Channel of the next conversion, read in the ADC interrupt before app_on_sample().
uint8_t app_next_channel(const App *self);
void app_on_sample(App *self, uint16_t counts);
void app_on_received(App *self, uint8_t byte, bool damaged);
bool app_on_ready(App *self, uint8_t *byte);  // false: nothing left to send

#endif
