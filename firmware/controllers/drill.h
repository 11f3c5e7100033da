// Drill driver: normal and pulse mode, electronic clutch, anti-kickback.
//
//   from        to       condition
//   RUN         COAST    current above 15 A (pulse = 1, no clutch)
//   COAST       PULSE    25 ms elapsed
//   PULSE       COAST    75 ms elapsed
//   COAST,PULSE RUN      mean current of 0.1 s below 8 A, from 0.1 s after the first coast on
//   any         STOPPED  the shaft slows down faster than any ordinary load slows it (kickback)
//   RUN         STOPPED  the load torque would peak at the setting of the clutch (clutch)
//   RUN         STOPPED  setting of the clutch out of range, at the start (unreachable)
//
// The speed is observed by the back-EMF e = d Vs - R i - L i', which has no delay by Hall edges:
// duty d, bus voltage Vs, current i, resistance R and inductance L of the winding; ' is a rate of
// change. The current of the load alone is i - J / k^2 e', where J / k^2 e' is that of the inertia
// J at the torque constant k. A jam removes more speed in a few ms than the current explains.
#ifndef VGROOVE_CONTROLLERS_DRILL_H
#define VGROOVE_CONTROLLERS_DRILL_H

#include <stdbool.h>
#include <stdint.h>

#include "controllers/blow.h"
#include "controllers/controller.h"

#define DRILL_BINS 10u  // of 10 ms: the moving average of pulse mode

typedef struct {
    int16_t clutch_dnm;   // setting of the clutch at the chuck in 0.1 N m; 0: no clutch
    uint16_t ratio_q8;    // gear ratio, motor / chuck
    uint16_t motor_mohm;  // winding
    uint16_t rpm_per_v;   // speed constant
    uint16_t pulse;       // 1: pulse mode above 15 A
    uint16_t kickback;    // 1: anti-kickback
} DrillSetpoints;

typedef enum {
    DRILL_RUN,
    DRILL_COAST,
    DRILL_PULSE,
    DRILL_STOPPED,
} DrillState;

typedef struct {
    int32_t level_a_q17;   // load current, low-pass filtered once
    int32_t smooth_a_q17;  // and twice
    int32_t set_a2_q8;     // square of the load current at the setting of the clutch
    int16_t last_a_q9;
    int16_t emf_mv;           // back-EMF of the last tick that measured it
    int16_t fallen_mv;        // sum of the falls of emf_mv beyond those of ordinary loads
    uint16_t mv_per_rpm_q12;  // back-EMF per 0.5 rpm
    int16_t limit_mv;         // back-EMF of the greatest speed with the clutch set
    int16_t now_a_q4;         // load current predicted for the opening of the bridge
    int16_t duty_q15;
    int16_t bins[DRILL_BINS];  // sums of 10 currents, / 16
    int16_t bin_sum;           // of the present bin, / 16
    uint16_t pulse_ms;         // since pulse mode began
    uint8_t phase_ms;          // since the last change between coast and pulse
    uint8_t bin;
    uint8_t bin_ms;
    uint8_t settling;   // ticks until the back-EMF can be measured
    uint8_t since_emf;  // ticks since its last measurement
    bool begun;         // the first step is over
    bool emf_known;     // the back-EMF has been measured in this drive
    bool slow;          // the load is filtered over 32 ms
    uint8_t state;      // DRILL_*
    uint8_t reason;     // CONTROLLER_REASON_*
} Drill;

void drill_start(Drill *self, const DrillSetpoints *set);
// Setpoints of a drive in reverse: clutch and pulse mode act in forward only, anti-kickback in both
// directions.
void drill_reverse(DrillSetpoints *set);

int16_t drill_step(Drill *self, const DrillSetpoints *set, const ControllerInputs *in,
                   const Blow *blow);
uint8_t drill_state(const Drill *self);
uint8_t drill_stop_reason(const Drill *self);

// Load current i of the clutch in 1/16 A; the torque at the chuck is (i - Tc / k) N k, with the
// Coulomb friction Tc and the gear ratio N.
int16_t drill_estimate(const Drill *self);

#endif
