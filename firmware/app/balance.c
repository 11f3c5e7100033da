// Plausibility of current sensor and bus voltage, see balance.h.
#include "app/balance.h"

#include "core/divide.h"
#include "core/fixed.h"
#include "core/inline.h"
#include "telemetry/telemetry_signals.h"

#define LEAST_RPM_Q1 6000  // 3000 rpm
#define SATURATED                                                                                  \
    (TELEMETRY_FLAGS_CURRENT_SATURATED | TELEMETRY_FLAGS_SPEED_SATURATED |                         \
     TELEMETRY_FLAGS_SUPPLY_SATURATED)
// Voltages of the motor's equation are in steps of 6.27 mV, those of the pack's in 3.12 mV.
#define TOLERANCE 96                // 0.6 V of the motor's equation
#define PACK_MORE (2 * TOLERANCE)   // added to TOLERANCE: 0.9 V of the pack's equation
#define DROP_PER_MOHM_Q16 20        // of A Q9
#define MOST_MOHM 1638              // a greater one would overflow the factor's 16 bits
#define EMF_Q16_RPM_PER_V 5222400u  // of rpm Q1, times rpm/V; within 16 bits from 160 rpm/V on

// Quantities of the balances.
typedef enum {
    MOTOR_VOLTAGE,
    DROP,  // R i
    EMF,   // k speed
    BUS_VOLTAGE,
    PACK_DROP,  // at 0.2 ohm, half of the greatest resistance
} Term;

void balance_set_motor(Balance *self, int16_t motor_mohm, uint16_t rpm_per_v) {
    const uint16_t emf_q16 = divide_by_u16(EMF_Q16_RPM_PER_V, rpm_per_v);
    self->drop_q16 =
        (int16_t)((motor_mohm < MOST_MOHM ? motor_mohm : MOST_MOHM) * DROP_PER_MOHM_Q16);
    self->emf_q16 = (int16_t)(emf_q16 < INT16_MAX ? emf_q16 : INT16_MAX);
}

void balance_reset(Balance *self) {
    self->ticks = 0;
    self->spans = 0;
}

void balance_collect(Balance *self, const Measurement *m, int16_t compare) {
    BY_POINTER(self);
    const int16_t rpm_q1 = m->speed_rpm_q1;
    if ((m->flags & SATURATED) != 0u || (rpm_q1 < LEAST_RPM_Q1 && rpm_q1 > -LEAST_RPM_Q1)) {
        self->ticks = 0;
        return;
    }
    if (self->ticks == 0u) {
        self->current_sum = 0;
        self->speed_sum = 0;
        self->compare_sum = 0;
        self->supply_sum = 0;
    }
    self->ticks++;
    self->current_sum = (int16_t)(self->current_sum + (m->current_a_q9 >> 5));
    self->speed_sum = (int16_t)(self->speed_sum + (rpm_q1 >> 5));
    self->compare_sum = (int16_t)(self->compare_sum + compare);
    self->supply_sum = (uint16_t)(self->supply_sum + m->supply_25mv);
}

bool balance_due(const Balance *self) {
    return self->ticks >= BALANCE_TICKS;
}

INLINE_NEVER static int16_t product(int16_t value, int16_t factor_q16) {
    return (int16_t)(((int32_t)value * factor_q16) >> 16);
}

// Whether a change is farther from 0 than the ranges of its factors and the tolerance allow.
INLINE_NEVER static bool beyond(int16_t change, int16_t range) {
    return fixed_magnitude(change) > range + TOLERANCE;
}

static bool contradicts(const Balance *self) {
    const int16_t drop = self->term[DROP].change;
    const int16_t emf = self->term[EMF].change;
    const int16_t pack = self->term[PACK_DROP].change;
    const int16_t rest = (int16_t)(self->term[MOTOR_VOLTAGE].change - drop - (drop >> 2) - emf);
    return beyond(rest, (int16_t)((fixed_magnitude(drop) >> 1) + (fixed_magnitude(emf) >> 3))) ||
           beyond((int16_t)(self->term[BUS_VOLTAGE].change + pack),
                  (int16_t)(fixed_magnitude(pack) + PACK_MORE));
}

// Stores the mean of each quantity over the span in `change`, where balance_judge() then puts its
// change.
static void take_means(Balance *self) {
    BalanceTerm *const term = self->term;
    term[EMF].change = product(self->speed_sum, self->emf_q16);
    term[DROP].change = product(self->current_sum, self->drop_q16);
    term[PACK_DROP].change = product(self->current_sum, self->compare_sum);
    const int16_t bus = (int16_t)(self->supply_sum >> 2);
    term[BUS_VOLTAGE].change = bus;
    term[MOTOR_VOLTAGE].change = product(bus, (int16_t)(4 * self->compare_sum));
}

INLINE_NEVER bool balance_judge(Balance *self) {
    BY_POINTER(self);
    if (self->ticks == BALANCE_TICKS) {
        take_means(self);
        self->ticks++;
        return false;
    }
    BalanceTerm *term = self->term;
    for (uint8_t k = BALANCE_TERMS; k > 0u; k--, term++) {
        const int16_t now = term->change;
        term->change = (int16_t)(now - term->before);
        term->before = term->last;
        term->last = now;
    }
    self->ticks = 0;
    if (self->spans < 2u) {
        self->spans++;
        return false;
    }
    return contradicts(self);
}
