// Blow detection, see blow.h.
#include "controllers/blow.h"

#define DEAD_MS 8u
#define PAUSE_MS 120u

void blow_start(Blow *self) {
    *self = (Blow){.since_ms = PAUSE_MS};
}

static void strike(Blow *self) {
    self->struck = true;
    self->impacting = self->since_ms < PAUSE_MS;
    self->period_ms = self->since_ms;
    self->count++;
    self->since_ms = 0;
}

// An eighth below the highest speed since the last blow is a dip, an eighth above its lowest ends it.
void blow_step(Blow *self, const ControllerInputs *in) {
    const int16_t speed = in->speed_rpm_q1;
    self->struck = false;
    self->since_ms = (uint16_t)(self->since_ms < PAUSE_MS ? self->since_ms + 1u : PAUSE_MS);
    self->impacting = self->impacting && self->since_ms < PAUSE_MS;
    if (self->falling) {
        self->low_rpm_q1 = speed < self->low_rpm_q1 ? speed : self->low_rpm_q1;
        self->falling = speed - self->low_rpm_q1 <= self->low_rpm_q1 >> 3;
        self->high_rpm_q1 = speed;
    } else {
        self->high_rpm_q1 = speed > self->high_rpm_q1 ? speed : self->high_rpm_q1;
        if (self->high_rpm_q1 - speed > self->high_rpm_q1 >> 3 && self->since_ms >= DEAD_MS) {
            self->falling = true;
            self->low_rpm_q1 = speed;
            strike(self);
        }
    }
}
