// Plain mode, see open_loop.h.
#include "controllers/open_loop.h"

#include "core/slew.h"

int16_t open_loop_step(OpenLoop *self, const ControllerInputs *in) {
    self->duty_q15 = slew_towards(self->duty_q15, in->travel_q15, self->slew_q15);
    return self->duty_q15;
}
