// Plausibility of current sensor and bus voltage during a drive: two balances that hold between any
// two spans of a drive, whatever the load does (parity equations with uncertain parameters).
//
//   motor:  D(duty Vs) = R D(i) + k D(speed)
//   pack:   D(Vs) = -Rp D(duty i)
//
// R is 0.75 to 1.75 times the parameter motor_mohm, k 0.87 to 1.12 times 1 / motor_rpm_per_v, Rp 0
// to 0.4 ohm.
// D is the change from the span before the last: a difference contains neither the drop of brushes
// and bridge nor the open-circuit voltage. The sensors contradict each other where no R and k
// within these ranges explain the change to within 0.6 V, or no Rp to within 0.9 V. A current
// sensor that steps by 8 A violates the first equation by 1.5 V, an ADC reference that falls by 9 %
// the second by 1.8 V. The 0.9 V allow a contact of the pack to change by 36 mohm at 25 A.
//
// A span is 32 ticks at 3000 rpm or more: below that a missed edge is not detected, and the
// measured speed is delayed by up to 5 ms. A slower tick restarts the span. A
// product is that of the means of its factors.
#ifndef VGROOVE_APP_BALANCE_H
#define VGROOVE_APP_BALANCE_H

#include <stdbool.h>
#include <stdint.h>

#include "app/measure.h"

#define BALANCE_TICKS 32u
#define BALANCE_TERMS 5u

// Quantity of the balances; change: from the span before the last.
typedef struct {
    int16_t change;
    int16_t before;
    int16_t last;
} BalanceTerm;

typedef struct {
    int16_t current_sum;  // 1/16 A, of 32 ticks Q9
    int16_t speed_sum;    // 16 rpm, of 32 ticks Q1
    int16_t compare_sum;
    uint16_t supply_sum;  // 25 mV
    BalanceTerm term[BALANCE_TERMS];
    int16_t drop_q16;  // R, a factor of current_sum
    int16_t emf_q16;   // k, a factor of speed_sum
    uint8_t ticks;     // in the sums
    uint8_t spans;     // in `last` and `before`, up to 2
} Balance;

void balance_set_motor(Balance *self, int16_t motor_mohm, uint16_t rpm_per_v);

// No drive is going on: the next one begins with new spans.
void balance_reset(Balance *self);

// Adds a tick at the applied compare value; call it in ticks with a driven, settled bridge.
void balance_collect(Balance *self, const Measurement *m, int16_t compare);

// Whether a span is complete. Then two calls of balance_judge() in any later ticks, before the next
// balance_collect(), return whether it is implausible; the first computes its means.
bool balance_due(const Balance *self);
bool balance_judge(Balance *self);

#endif
