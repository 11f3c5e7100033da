// Drill driver: normal and pulse mode, electronic clutch, anti-kickback.
//
//            current past 15 A (pulse = 1, no clutch)
//     RUN ------------------------------------------> COAST <-------- 75 ms --------- PULSE
//      ^                                                |  ------- 25 ms -----------> |
//      |                                                |                              |
//      +------ mean of 0.1 s below 8 A, from 0.1 s after the first coast on -----------+
//     any ---- the shaft falls faster than any ordinary load can slow it ------> STOPPED (kickback)
//     RUN ---- the chuck's torque would come to rest at the clutch's setting --> STOPPED (clutch);
//     a setting out of reach: refused
//
// What turns is followed by the voltage that it induces, e = d Vs - R i - L i', which no Hall edge
// delays. Its fall tells the inertia's torque: i - J / k^2 e' is the current that the load alone
// takes. A jam takes away more speed in a few ms than the current can explain.
#ifndef VGROOVE_CONTROLLERS_DRILL_H
#define VGROOVE_CONTROLLERS_DRILL_H

#include <stdbool.h>
#include <stdint.h>

#include "controllers/blow.h"
#include "controllers/controller.h"

#define DRILL_BINS 10u  // of 10 ms: the moving average of pulse mode

typedef struct {
    int16_t clutch_dnm;   // set torque at the chuck in 0.1 N m; 0: no clutch
    uint16_t ratio_q8;    // gear ratio, motor / chuck
    uint16_t motor_mohm;  // of the winding
    uint16_t rpm_per_v;   // speed constant
    uint16_t pulse;       // pulse mode above 15 A
    uint16_t kickback;    // anti-kickback
} DrillSetpoints;

typedef enum {
    DRILL_RUN,
    DRILL_COAST,
    DRILL_PULSE,
    DRILL_STOPPED,
} DrillState;

typedef struct {
    int32_t level_a_q17;   // load current, filtered once
    int32_t smooth_a_q17;  // and twice
    int32_t set_a2_q8;     // square of the load current at the clutch's torque; 0: no clutch
    int16_t last_a_q9;
    int16_t emf_mv;           // of the last tick that told it
    int16_t fallen_mv;        // of the emf beyond what ordinary loads take, summed up
    uint16_t mv_per_rpm_q16;  // induced, per 1/2 rpm
    int16_t limit_mv;         // emf that the clutch allows
    int16_t now_a_q4;         // load current foreseen for the bridge's opening
    int16_t duty_q15;
    int16_t bins[DRILL_BINS];  // sums of 10 currents / 16
    int16_t bin_sum;           // of the bin at work, / 16
    uint16_t pulse_ms;         // since pulse mode began
    uint8_t phase_ms;          // since the last change between coast and pulse
    uint8_t bin;
    uint8_t bin_ms;
    uint8_t blind;   // ticks until the emf can be told
    uint8_t gap;     // ticks since it was
    bool begun;      // the first step is over
    bool known;      // the emf has been told in this drive
    bool slow;       // the load is filtered over 32 ms
    uint8_t state;   // DRILL_*
    uint8_t reason;  // CONTROLLER_REASON_*
} Drill;

void drill_start(Drill *self, const DrillSetpoints *set);
// Clutch and pulse mode act in the direction that tightens only; a jam kicks in both.
void drill_reverse(DrillSetpoints *set);

int16_t drill_step(Drill *self, const DrillSetpoints *set, const ControllerInputs *in,
                   const Blow *blow);
uint8_t drill_state(const Drill *self);
uint8_t drill_stop_reason(const Drill *self);
int16_t drill_estimate(const Drill *self);  // load current of the clutch in 1/16 A; (i - Tc / k) N
                                            // k is the torque at the chuck

#endif
