// Steps filters and controllers through recorded inputs; compiled twice from the same source: with
// the fixed-point integers, and with the floating-point types of real.hpp (docs/fixed_point.md).
#ifndef VGROOVE_HIL_FIXED_POINT_REPLAY_CORE_HPP
#define VGROOVE_HIL_FIXED_POINT_REPLAY_CORE_HPP

#ifdef VGROOVE_REAL
#include "real.hpp"
#define EXTERN_C extern "C++"
#else
#include <stdbool.h>
#include <stdint.h>
#define EXTERN_C extern "C"
#endif

EXTERN_C {
#include "controllers/blow.h"
#include "controllers/drill.h"
#include "controllers/screwing.h"
#include "controllers/sync.h"
#include "controllers/torque.h"
#include "controllers/vibration.h"
#include "drivers/current_sense.h"
#include "drivers/hall_speed.h"
}

#undef int16_t
#undef uint16_t
#undef int32_t
#undef uint32_t

namespace replay {

#ifdef VGROOVE_REAL
using Value = real::Real;
using S16 = real::Int16;
using U16 = real::Uint16;
using Result = real::Scalar;
inline Result result(const Value &value) {
    return value.v;
}
#else
using S16 = int16_t;
using U16 = uint16_t;
using Result = double;
template <class T> Result result(T value) {
    return static_cast<Result>(value);
}
#endif

// Values of signal `mode` (firmware/telemetry/vgroove.dbc)
enum Mode : uint8_t { DUTY, SYNC, SCREWING, VIBRATION, TORQUE, DRILL };

constexpr unsigned SETPOINTS = 10;
constexpr unsigned PULSES = 4, TIMEOUT_MS = 300;  // defaults of hall_pulses, hall_timeout_ms

// As in the record of a tick, firmware/hal/sim/sim.h.
struct __attribute__((packed)) Start {
    uint8_t mode;
    int16_t set[SETPOINTS];
    uint16_t blow_set[4];
};

struct __attribute__((packed)) Step {
    int16_t travel_q15, speed_rpm_q1, current_a_q9, duty_q15, trigger_q15;
    uint16_t supply_mv;
    uint8_t coasted, edges;
};

struct __attribute__((packed)) Filter {
    uint16_t stamps[4];
    uint16_t current_sum, current_offset_q4, current_gain_a_q15;
    uint8_t stamp_count, current_count;
};

// What a step computes, in the steps of its format.
struct Output {
    Result requested_q15, estimate;
    uint8_t state, stop_reason;
    uint16_t blows;
};

struct Measured {
    Result current_a_q9, speed_rpm_q1;
};

template <class Setpoints> void fill(Setpoints &set, const int16_t *words) {
    auto *to = reinterpret_cast<S16 *>(&set);
    for (unsigned k = 0; k < sizeof(Setpoints) / sizeof(S16); ++k) {
        to[k] = static_cast<S16>(words[k]);
    }
}

class Controller {
public:
    void start(const Start &given) {
        mode_ = static_cast<Mode>(given.mode);
        blow_set_.turn_q8 = static_cast<U16>(given.blow_set[0]);
        blow_set_.source = static_cast<U16>(given.blow_set[1]);
        blow_set_.motor_mohm = static_cast<U16>(given.blow_set[2]);
        blow_set_.motor_rpm_per_v = static_cast<U16>(given.blow_set[3]);
        blow_start(&blow_, &blow_set_);
        int16_t words[SETPOINTS];
        for (unsigned k = 0; k < SETPOINTS; ++k) {
            words[k] = given.set[k];
        }
        fill(sync_set_, words);
        fill(screwing_set_, words);
        fill(vibration_set_, words);
        fill(torque_set_, words);
        fill(drill_set_, words);
        begin();
    }

    void take(const Step &given) {
        in_.travel_q15 = static_cast<S16>(given.travel_q15);
        in_.speed_rpm_q1 = static_cast<S16>(given.speed_rpm_q1);
        in_.current_a_q9 = static_cast<S16>(given.current_a_q9);
        in_.supply_mv = static_cast<U16>(given.supply_mv);
        in_.duty_q15 = static_cast<S16>(given.duty_q15);
        in_.coasted = given.coasted != 0;
        in_.trigger_q15 = static_cast<S16>(given.trigger_q15);
        in_.edges = given.edges;
    }

    // The computation whose cycles are counted.
    void step() {
        if (mode_ != DUTY && mode_ != DRILL) {
            blow_step(&blow_, &blow_set_, &in_);
        }
        requested_ = dispatch();
    }

    Output output() const;

private:
    void begin();
    S16 dispatch();

    Mode mode_ = DUTY;
    ControllerInputs in_;
    Blow blow_;
    BlowSetpoints blow_set_;
    Sync sync_;
    SyncSetpoints sync_set_;
    Screwing screwing_;
    ScrewingSetpoints screwing_set_;
    Vibration vibration_;
    VibrationSetpoints vibration_set_;
    Torque torque_;
    TorqueSetpoints torque_set_;
    Drill drill_;
    DrillSetpoints drill_set_;
    S16 requested_;
};

class Filters {
public:
    Filters() : hall_(), current_() { hall_speed_configure(&hall_, PULSES, U16(TIMEOUT_MS)); }
    void take(const Filter &given) {
        current_.gain_a_q15 = static_cast<S16>(static_cast<int16_t>(given.current_gain_a_q15));
        current_.offset_q4 = static_cast<S16>(static_cast<int16_t>(given.current_offset_q4));
        given_ = given;
        for (uint8_t k = 0; k < given.stamp_count; ++k) {
            hall_speed_on_edge(&hall_, static_cast<U16>(given.stamps[k]));
        }
    }
    // The computation whose cycles are counted.
    void step();
    Measured output() const { return {current_a_q9_, speed_rpm_q1_}; }

private:
    HallSpeed hall_;
    CurrentSense current_;
    Filter given_{};
    Result current_a_q9_ = 0, speed_rpm_q1_ = 0;
};

}  // namespace replay

#endif
