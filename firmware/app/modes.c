// State machine, see modes.h.
#include "app/modes.h"

void modes_init(Modes *self) {
    *self = (Modes){.state = MODES_CALIBRATE};
}

static ModesState next_of_idle(const Modes *self, const ModesInputs *m) {
    if (m->calibrating && m->standstill) {
        return MODES_CALIBRATE;
    }
    const bool direction_allowed = m->standstill || m->reverse_switch == self->reverse;
    return m->pressed && self->armed && direction_allowed ? MODES_DRIVE : MODES_IDLE;
}

static ModesState next_of_release(const Modes *self, const ModesInputs *m) {
    if (m->pressed && self->armed && m->reverse_switch == self->reverse) {
        return MODES_DRIVE;
    }
    return m->standstill ? MODES_IDLE : MODES_RELEASE;
}

static ModesState next_of_drive(const Modes *self, const ModesInputs *m) {
    if (!m->pressed || m->reverse_switch != self->reverse) {
        return MODES_RELEASE;
    }
    return m->stopped ? MODES_STOPPED : MODES_DRIVE;
}

ModesState modes_next(const Modes *self, const ModesInputs *m) {
    if (m->fault && self->state != MODES_FAULT) {
        return MODES_FAULT;
    }
    switch ((ModesState)self->state) {
    case MODES_IDLE:
        return next_of_idle(self, m);
    case MODES_DRIVE:
        return next_of_drive(self, m);
    case MODES_RELEASE:
        return next_of_release(self, m);
    case MODES_FAULT:
        return m->contact || m->fault_persists ? MODES_FAULT : MODES_IDLE;
    case MODES_STOPPED:
        return m->contact ? MODES_STOPPED : MODES_IDLE;
    case MODES_CALIBRATE:
        return m->calibrating ? MODES_CALIBRATE : MODES_IDLE;
    }
    return MODES_FAULT;
}

ModesCommand modes_output(const Modes *self, bool release_ramps) {
    if (self->state == MODES_DRIVE) {
        return MODES_COMMAND_DRIVE;
    }
    return self->state == MODES_RELEASE && release_ramps ? MODES_COMMAND_RAMP_DOWN
                                                         : MODES_COMMAND_COAST;
}

void modes_step(Modes *self, const ModesInputs *m) {
    const ModesState next = modes_next(self, m);
    if (next == MODES_FAULT || next == MODES_STOPPED || self->state == MODES_CALIBRATE ||
        (m->contact && m->reverse_switch != self->reverse)) {
        self->armed = false;
    } else if (!m->contact) {
        self->armed = true;
    }
    if (next == MODES_IDLE && m->standstill) {
        self->reverse = m->reverse_switch;
    }
    self->state = (uint8_t)next;
}
