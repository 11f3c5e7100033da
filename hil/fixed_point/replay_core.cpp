// Dispatch to the controllers and filters, see replay_core.hpp.
#include "replay_core.hpp"

namespace replay {

void Controller::begin() {
    switch (mode_) {
    case DUTY:
        break;
    case SYNC:
        sync_start(&sync_, &sync_set_);
        break;
    case SCREWING:
        screwing_start(&screwing_, &screwing_set_);
        break;
    case VIBRATION:
        vibration_start(&vibration_, &vibration_set_);
        break;
    case TORQUE:
        torque_start(&torque_, &torque_set_);
        break;
    case DRILL:
        drill_start(&drill_, &drill_set_);
        break;
    }
}

S16 Controller::dispatch() {
    switch (mode_) {
    case DUTY:
        break;
    case SYNC:
        return sync_step(&sync_, &sync_set_, &in_, &blow_);
    case SCREWING:
        return screwing_step(&screwing_, &screwing_set_, &in_, &blow_);
    case VIBRATION:
        return vibration_step(&vibration_, &vibration_set_, &in_, &blow_);
    case TORQUE:
        return torque_step(&torque_, &torque_set_, &in_, &blow_);
    case DRILL:
        return drill_step(&drill_, &drill_set_, &in_, &blow_);
    }
    return in_.travel_q15;
}

Output Controller::output() const {
    Output out{result(requested_), 0, 0, 0, static_cast<uint16_t>(result(blow_.count))};
    switch (mode_) {
    case DUTY:
        break;
    case SYNC:
        out.state = sync_state(&sync_);
        out.stop_reason = sync_stop_reason(&sync_);
        out.estimate = result(sync_estimate(&sync_));
        break;
    case SCREWING:
        out.state = screwing_state(&screwing_);
        out.stop_reason = screwing_stop_reason(&screwing_);
        out.estimate = result(screwing_estimate(&screwing_));
        break;
    case VIBRATION:
        out.state = vibration_state(&vibration_);
        out.stop_reason = vibration_stop_reason(&vibration_);
        out.estimate = result(vibration_estimate(&vibration_));
        break;
    case TORQUE:
        out.state = torque_state(&torque_);
        out.stop_reason = torque_stop_reason(&torque_);
        out.estimate = result(torque_estimate(&torque_));
        break;
    case DRILL:
        out.state = drill_state(&drill_);
        out.stop_reason = drill_stop_reason(&drill_);
        out.estimate = result(drill_estimate(&drill_));
        break;
    }
    return out;
}

// The floating-point current is the mean of the counts times the gain: the fixed point's tables
// and roundings approximate it.
static Result current_of(const CurrentSense &sense, const Filter &given) {
#ifdef VGROOVE_REAL
    const Result mean = Result(given.current_sum) / Result(given.current_count);
    return (Result(16) * mean - sense.offset_q4.v) * sense.gain_a_q15.v / Result(1024);
#else
    bool saturated = false;
    const int16_t mean_q4 = current_sense_mean_q4(given.current_sum, given.current_count);
    return current_sense_a_q9(&sense, mean_q4, &saturated);
#endif
}

void Filters::step() {
    if (given_.current_count > 0) {
        current_a_q9_ = current_of(current_, given_);
    }
    speed_rpm_q1_ = result(hall_speed_tick(&hall_).rpm_q1);
}

}  // namespace replay
