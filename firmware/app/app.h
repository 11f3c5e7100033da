// The whole state of the firmware, and what the hardware layer calls: start, tick, interrupts.
//
// A tick: read (edges, samples, switches) -> faults -> state machine -> controller -> fold-back ->
// stage the bridge -> commands -> report.
#ifndef VGROOVE_APP_H
#define VGROOVE_APP_H

#include <stdbool.h>
#include <stdint.h>

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
    AdcSequence adc;  // first: the AVR's ADC interrupt reaches it by displacement
    ParamStore params;
    CurrentSense current;
    Trigger trigger;
    HallSpeed hall;
    HBridge bridge;
    Uart uart;
    Measurement measured;
    Faults faults;
    FaultLimits fault_limits;
    Standstill standstill;
    Modes modes;
    Control control;
    Foldback foldback;
    CommandParser parser;
    Command command;  // the last one received
    Telemetry telemetry;
    TelemetryInputs report;                   // kept from tick to tick: most of it seldom changes
    uint8_t spare[TELEMETRY_TICK_BYTES_MAX];  // frames that the queue has no room for
    uint16_t worst_cycles;                    // of a tick since the last HEALTH frame
    uint16_t kept_flags;                      // of the ticks that had no time to tell their state
    uint16_t standing_flags;                  // TELEMETRY_FLAGS_* of the start
    int16_t duty_limit_q15;                   // duty at full trigger, a setpoint
    int16_t ramp_q15;                         // of the trigger, at most slew_q15 a tick
    int16_t slew_q15;
    int16_t wish_q15;       // the controller's last
    int16_t ramp_duty_q15;  // last duty that was driven, and the speed then: what a resumed drive
                            // begins with
    int16_t ramp_speed_rpm_q1;
    uint8_t calibration;  // TELEMETRY_CALIBRATE_WHAT_*, CANCEL: none
    uint8_t host_mode;  // asked for by SET_MODE, at the start by the parameter; holds at position 0
                        // of the mode switch
    uint8_t mode;       // TELEMETRY_MODE_*, selected
    bool driving;       // the ramp goes on
    bool controlled;    // the controller acts
    uint16_t calibration_ticks;
    uint16_t trigger_least;  // counts seen while its ends are learned
    uint16_t trigger_greatest;
    bool save_offset;  // the offset found at rest becomes a parameter
    uint8_t overruns;
    uint8_t configure_step;  // next one, see configure.c
    bool calibrated;
    bool hall_taken;     // pitches learned so far were within their range
    bool command_waits;  // to be executed and acknowledged
    bool heavy;          // the drive had much to compute in this tick
    uint8_t full_ticks;  // in which it had, or two edges, one after the other: all slow work is
                         // held back
    bool slow_turn;      // a slow frame has been held back for other work: it goes first now
} App;

void app_init(App *self, uint32_t build_hash);

// `ticks_late`: ticks that have come since this one and wait.
void app_tick(App *self, uint8_t ticks_late);

// Interrupts; the one that applies the staged order to the bridge comes before all others.
void app_on_tick(App *self);
void app_on_apply(App *self);
void app_on_edge(App *self, uint16_t stamp);
uint8_t app_next_channel(const App *self);  // of the conversion after the one that has just
                                            // completed; ask before app_on_sample
void app_on_sample(App *self, uint16_t counts);
void app_on_received(App *self, uint8_t byte, bool damaged);
bool app_on_ready(App *self, uint8_t *byte);  // false: nothing left to send

#endif
