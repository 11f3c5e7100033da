// Plausibility of current sensor and bus voltage, see balance.h.
#include "app/balance.h"

#include "core/divide.h"
#include "core/inline.h"
#include "telemetry/telemetry_signals.h"

#define LEAST_RPM_Q1 6000  // 3000 rpm
#define SATURATED                                                                                  \
    (TELEMETRY_FLAGS_CURRENT_SATURATED | TELEMETRY_FLAGS_SPEED_SATURATED |                         \
     TELEMETRY_FLAGS_SUPPLY_SATURATED)
#define TOLERANCE 75  // 0.6 V of the motor's balance, 0.3 V of the pack's

// Factors Q16 of the sums.
#define SUPPLY_4MV 12800            // 25 mV / 32
#define DROP_8MV_PER_MOHM 16        // A Q9
#define EMF_8MV_RPM_PER_V 4096000u  // rpm Q1, times rpm/V; at 125 rpm/V 3000 rpm are 24 V

// Terms of a span.
typedef enum {
    MOTOR_VOLTAGE,  // 8 mV
    DROP,           // 8 mV, R i
    EMF,            // 8 mV, k speed
    BUS_VOLTAGE,    // 4 mV
    PACK_DROP,      // 4 mV, at 0.125 ohm: half of the greatest resistance
} Term;

// -32768 keeps its value.
INLINE_NEVER static int16_t size(int16_t value) {
    return (int16_t)(value < 0 ? -(uint16_t)value : (uint16_t)value);
}

void balance_reset(Balance *self) {
    self->ticks = 0;
    self->spans = 0;
}

INLINE_NEVER void balance_collect(Balance *self, const Measurement *m, int16_t compare,
                                  bool settled) {
    BY_POINTER(self);
    const int16_t rpm_q1 = m->speed_rpm_q1;
    if (!settled || (m->flags & SATURATED) != 0u ||
        (rpm_q1 < LEAST_RPM_Q1 && rpm_q1 > -LEAST_RPM_Q1)) {
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
    return self->ticks == BALANCE_TICKS;
}

INLINE_NEVER static int16_t product(int16_t value, int16_t factor_q16) {
    return (int16_t)(((int32_t)value * factor_q16) >> 16);
}

// Whether a change is farther from 0 than the ranges of its factors and the tolerance allow.
INLINE_NEVER static bool beyond(int16_t change, int16_t range) {
    return size(change) > range + TOLERANCE;
}

static bool contradicts(const Balance *self) {
    const int16_t drop = self->term[DROP].change;
    const int16_t emf = self->term[EMF].change;
    const int16_t pack = self->term[PACK_DROP].change;
    const int16_t rest = (int16_t)(self->term[MOTOR_VOLTAGE].change - drop - (drop >> 2) - emf);
    return beyond(rest, (int16_t)((size(drop) >> 1) + (size(emf) >> 3))) ||
           beyond((int16_t)(self->term[BUS_VOLTAGE].change + pack), size(pack));
}

INLINE_NEVER bool balance_judge(Balance *self, int16_t motor_mohm, uint16_t rpm_per_v) {
    BY_POINTER(self);
    BalanceTerm *term = self->term;
    term[EMF].change =
        product(self->speed_sum, (int16_t)divide_by_u16(EMF_8MV_RPM_PER_V, rpm_per_v));
    term[DROP].change = product(self->current_sum, (int16_t)(motor_mohm * DROP_8MV_PER_MOHM));
    term[PACK_DROP].change = product(self->current_sum, (int16_t)(self->compare_sum >> 1));
    const int16_t bus_4mv = product((int16_t)self->supply_sum, SUPPLY_4MV);
    term[BUS_VOLTAGE].change = bus_4mv;
    term[MOTOR_VOLTAGE].change = product(bus_4mv, (int16_t)(4 * self->compare_sum));
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
