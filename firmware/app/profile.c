// Commanded duty, see profile.h.
#include "app/profile.h"

#include "controllers/controller.h"

void profile_take(Profile *self, int16_t duty_q15) {
    self->duty_q15 = duty_q15;
    self->left_ms = PROFILE_HOLD_MS;
    self->acts = true;
}

void profile_tick(Profile *self, bool drives) {
    if (self->left_ms > 0u) {
        self->left_ms--;
    } else if (!drives) {
        self->acts = false;
    }
}

ProfileState profile_state(const Profile *self) {
    return self->acts ? PROFILE_ACTING : PROFILE_NONE;
}

int16_t profile_duty(const Profile *self, int16_t travel_q15) {
    if (!self->acts) {
        return travel_q15;
    }
    if (self->left_ms == 0u) {
        return CONTROLLER_STOP;
    }
    if (self->duty_q15 < 0) {
        return CONTROLLER_COAST;
    }
    return self->duty_q15 < travel_q15 ? self->duty_q15 : travel_q15;
}
