// The equations of motion of the generated impact tool, and their integration by the embedded
// Runge-Kutta pair of Bogacki and Shampine (1989).
#include "impact.hpp"

#include <algorithm>
#include <cmath>

namespace truth {
namespace {

constexpr double TURN = 6.283185307179586;
constexpr double COPPER_PER_KELVIN = 0.00393;  // resistivity of annealed copper at 20 C, IEC 60028
constexpr double EVENT_S = 5e-7;               // length of a step in which the lugs' place changes
constexpr double SHORTEST_S = 2e-8;
constexpr double SHORTEST_LAG_S =
    1e-5;                         // of the current sensor: shorter ones would only slow the steps
constexpr double COAST_A = 0.02;  // below it the diodes of an open bridge block
// Error allowed per step: A, rad/s, rad, in the order of StateIndex
constexpr double ALLOWED[CONTROLLED_COUNT] = {2e-3, 2e-3, 1e-6, 4e-3, 1e-6, 4e-3, 4e-7, 4e-7,
                                              1e-5, 4e-3, 4e-7, 1e-2, 1e-5, 2e-2, 2e-2};

double sign(double x) {
    return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : 0.0);
}

// (|x| / reference)^power, constant below a fiftieth of the reference, since a negative power
// diverges at 0.
double power_law(double x, double reference, double power) {
    return std::pow(std::max(std::abs(x) / reference, 0.02), power);
}

}  // namespace

void ImpactTool::start() {
    state = StateVector{};
    slow = SlowStates{};
    time_s = 0.0;
    edges.clear();
    blows.clear();
    commands.clear();
    dead_share = 0.0;
    random = RandomStream(static_cast<std::uint64_t>(params.seed));
    place_ = LugPlace::GAP;
    lug_ = 0;
    last_lug_ = -1000000;
    touching_ = false;
    steps = 0;
    first_known_ = false;
    step_s_ = 1e-6;
    state[HAMMER] = state[SPINDLE] = params.hammer_start_rad;
    bristle_nm_per_rad_ = std::max(params.coulomb_nm, 1e-4) / 0.001;
    bristle_nm_s_ = 1.4 * std::sqrt(bristle_nm_per_rad_ * params.inertia_kg_m2);
    slow.gate_until_s = params.gate_off_s * (0.5 + random.uniform());
    slow_rates(0.0);
    const double angle = hall_angle(motor_angle());
    edge_index_ = 0;
    if (params.hall_edges > 0.0) {
        edge_index_ = static_cast<long>(
            std::floor((angle - params.hall_offset_rad) * params.hall_edges / TURN));
    }
}

double ImpactTool::motor_speed() const {
    return params.ratio * (state[SPINDLE_SPEED] - state[ARM_SPEED]);
}

double ImpactTool::motor_angle() const {
    return params.ratio * (state[SPINDLE] - params.hammer_start_rad - state[ARM]);
}

double ImpactTool::travel_m() const {
    return groove(state[SPINDLE] - state[HAMMER]).travel;
}

// x = l (sqrt(q^2 + e^2) - e), and a worn place of the groove: a dent at one angle of both flanks.
ImpactTool::Groove ImpactTool::groove(double q) const {
    const double l = params.groove_lead_m_per_rad, e = params.vertex_rad;
    const double root = std::sqrt(q * q + e * e);
    Groove g{l * (root - e), l * q / root, l * e * e / (root * root * root)};
    if (params.u_groove_dent_m != 0.0) {
        const double width = params.u_dent_width_rad;
        const double z = (std::abs(q) - params.u_dent_at_rad) / width;
        const double dent = params.u_groove_dent_m * std::exp(-z * z);
        g.travel -= dent;
        g.slope += dent * 2.0 * z / width * sign(q);
        g.bend += dent * (2.0 - 4.0 * z * z) / (width * width);
    }
    return g;
}

// Force of a penalty contact, its elastic and its damping part: k d, and b d' while approaching,
// the damping rising over the ramp.
ImpactTool::Contact ImpactTool::contact(double depth, double rate) const {
    if (depth <= 0.0) {
        return {0.0, 0.0};
    }
    const double ramp = std::min(depth / params.contact_ramp_m, 1.0);
    const double damping =
        params.contact_damping_n_s_per_m * ramp + params.extra_damping_n_s_per_m2 * depth;
    return {params.contact_stiffness_n_per_m * depth, rate > 0.0 ? damping * rate : 0.0};
}

// Angle between hammer and anvil at which the hammer touches the lug in front of it.
double ImpactTool::flank(long lug) const {
    const double offset = (lug % 2 != 0) ? params.u_lug_offset_rad : 0.0;
    return static_cast<double>(lug) * TURN / params.lug_count + offset;
}

double ImpactTool::height(long lug) const {
    return params.lug_height_m - ((lug % 2 != 0) ? params.u_lug_height_m : 0.0);
}

double ImpactTool::gap_width() const {
    return TURN / params.lug_count - params.lug_overlap_rad;
}

// Torque of the lugs' flanks on the anvil.
ImpactTool::Push ImpactTool::lug_push(const StateVector &y) const {
    if (place_ != LugPlace::GAP) {
        return {0.0, 0.0};
    }
    const double r = params.lug_radius_m;
    const double ahead = y[HAMMER] - y[ANVIL] - flank(lug_);
    const double behind = flank(lug_ - 1) + params.lug_overlap_rad - (y[HAMMER] - y[ANVIL]);
    const double rate = y[HAMMER_SPEED] - y[ANVIL_SPEED];
    const Contact front = contact(r * ahead, r * rate), rear = contact(r * behind, -r * rate);
    const double nm = r * (front.stored_n + front.damping_n - rear.stored_n - rear.damping_n);
    return {nm, r * std::abs(rate) * (front.damping_n + rear.damping_n)};
}

// Axial contact forces: the end stop pushes the hammer forward (positive), the top of a lug holds
// it back.
ImpactTool::Contact ImpactTool::axial(const Groove &g, double rate) const {
    const double e = params.vertex_rad, q = params.travel_rad;
    const double stop = params.groove_lead_m_per_rad * (std::sqrt(q * q + e * e) - e);
    const Contact end = contact(g.travel - stop, rate);
    if (place_ != LugPlace::OVER) {
        return end;
    }
    const Contact top = contact(height(lug_) - g.travel, -rate);
    return {end.stored_n - top.stored_n, end.damping_n - top.damping_n};
}

double ImpactTool::slip_torque(double head, const double *table) const {
    if (table == nullptr || slip.count < 2) {
        return 0.0;
    }
    const double place = (head - slip.first_rad) / slip.step_rad;
    const double inside = std::clamp(place, 0.0, slip.count - 1.000001);
    const auto n = static_cast<int>(inside);
    return table[n] + (table[n + 1] - table[n]) * (inside - n);
}

// The joint: T = K e + C w within the slip torques; e' = (T - K e) / C. With a coupler it turns
// with the far side of the bit.
void ImpactTool::joint_rates(const StateVector &y, StateVector &d) {
    const ImpactParams &p = params;
    const bool bit = p.coupler_nm_per_rad > 0.0;
    const double speed = bit ? y[BIT_SPEED] : y[ANVIL_SPEED], angle = bit ? y[BIT] : y[ANVIL];
    const double head = angle - y[TWIST];
    const double soft = 1.0 / (1.0 + p.u_heat_per_joule * slow.joint_heat);
    const double elastic =
        p.joint_nm_per_rad * y[TWIST] * (1.0 + p.joint_cubic_per_rad2 * y[TWIST] * y[TWIST]);
    joint_nm_ = std::clamp(elastic + p.joint_nm_s_per_rad * speed,
                           -soft * slip_torque(head, slip.backward_nm),
                           soft * slip_torque(head, slip.forward_nm));
    d[TWIST] = (joint_nm_ - elastic) / p.joint_nm_s_per_rad;
    slip_rate_ = speed - d[TWIST];
    double on_anvil = joint_nm_;
    d[LOST_J] += joint_nm_ * speed - elastic * d[TWIST];
    if (bit) {
        const double half = 0.5 * p.u_bit_play_rad, twist = y[ANVIL] - y[BIT];
        const double bent = twist > half ? twist - half : (twist < -half ? twist + half : 0.0);
        const double rate = y[ANVIL_SPEED] - y[BIT_SPEED];
        const bool engaged = p.u_bit_play_rad <= 0.0 || bent != 0.0;
        const double damping = engaged ? p.coupler_nm_s_per_rad * rate : 0.0;
        on_anvil = p.coupler_nm_per_rad * bent + damping;
        d[BIT_SPEED] = (on_anvil - joint_nm_) / std::max(p.coupler_inertia_kg_m2, 1e-7);
        d[BIT] = y[BIT_SPEED];
        d[LOST_J] += damping * rate;
    }
    d[ANVIL_SPEED] = -on_anvil / p.anvil_inertia_kg_m2;
    d[ANVIL] = y[ANVIL_SPEED];
}

double ImpactTool::saturated_k(double current) const {
    if (params.saturation_a <= 0.0) {
        return k_;
    }
    const double x = std::sqrt(3.0) * std::abs(current) / params.saturation_a;
    return x < 1e-6 ? k_ : k_ * std::tanh(x) / x;
}

// Mean voltage at the motor; dead time takes its part by the sign of the current over its ripple.
double ImpactTool::bridge_voltage(double duty, double bus, double current) const {
    double volts = duty * bus;
    const double lost = 2.0 * params.dead_time_s * params.pwm_hz + dead_share;
    if (lost > 0.0 && duty != 0.0 && std::abs(duty) < 1.0) {
        const double ripple = std::max(0.2, std::abs(duty) * (1.0 - std::abs(duty)) * bus /
                                                (2.0 * params.inductance_h * params.pwm_hz));
        volts -= lost * bus * current / std::sqrt(current * current + 0.4 * ripple * ripple);
    }
    if (params.brush_drop_v != 0.0) {
        volts -= params.brush_drop_v * sign(current) *
                 (1.0 - std::exp(-std::abs(current) / params.brush_knee_a));
    }
    return volts;
}

// Current, charge and the integral of the bus voltage.
void ImpactTool::electric_rates(double t, const StateVector &y, StateVector &d) const {
    const double duty = duty_begin_ + duty_rate_ * (t - duty_from_s_);
    const double i = y[CURRENT], w = params.ratio * (y[SPINDLE_SPEED] - y[ARM_SPEED]);
    const double emf = saturated_k(i) * w;
    double bus = open_circuit_v_, volts = 0.0;
    if (coast_) {
        const double diode = i != 0.0 ? -sign(i) * bus : emf;
        volts = std::abs(i) < COAST_A && std::abs(emf) < bus ? emf + i * resistance_ : diode;
        bus -= source_ohm_ * -std::abs(i);
    } else {
        bus -= source_ohm_ * duty * i;
        volts = bridge_voltage(duty, bus, i);
    }
    d[CURRENT] = (volts - resistance_ * i - emf) / params.inductance_h;
    d[BUS] = bus * (1.0 + params.supply_gain);
    d[CHARGE] = i;
    d[INPUT_J] = volts * i;
    d[LOST_J] += resistance_ * i * i;
    d[SENSED_CHARGE] = sensed(sensor_rates(i, y, d));
}

// The filter of the current sensor, of one stage or two; returns its output.
double ImpactTool::sensor_rates(double current, const StateVector &y, StateVector &d) const {
    if (params.current_lag_s < SHORTEST_LAG_S) {
        return current;
    }
    double from = current;
    if (params.current_lag2_s > 0.0) {
        d[SENSED_FIRST] = (current - y[SENSED_FIRST]) / params.current_lag2_s;
        from = y[SENSED_FIRST];
    }
    d[SENSED] = (from - y[SENSED]) / params.current_lag_s;
    return y[SENSED];
}

double ImpactTool::sensed_current() const {
    return sensed(params.current_lag_s >= SHORTEST_LAG_S ? state[SENSED] : state[CURRENT]);
}

double ImpactTool::sensed(double current) const {
    const double bend =
        1.0 + params.current_gain_bend * (std::abs(current) / params.reference_a - 1.0);
    const double value = current * (1.0 + params.current_gain * bend) + params.current_offset_a;
    return params.current_limit_a > 0.0
               ? std::clamp(value, -params.current_limit_a, params.current_limit_a)
               : value;
}

// Largest dry friction of the motor.
double ImpactTool::dry_level(double w, double current) const {
    const ImpactParams &p = params;
    double level = p.coulomb_nm + wander_nm_ + (slow.gate ? p.u_load_nm : 0.0);
    if (p.breakaway_nm != 0.0) {
        level += p.breakaway_nm * std::exp(-std::pow(w / p.stribeck_rad_s, 2.0));
    }
    if (p.power_coulomb_nm != 0.0) {
        level += p.power_coulomb_nm * power_law(w, p.reference_rad_s, p.coulomb_power);
    }
    if (p.load_friction != 0.0) {
        const double load = std::abs(k_ * current);
        level += p.load_friction * load *
                 power_law(load, p.load_reference_nm, p.load_friction_power - 1.0);
    }
    return std::max(level, 0.0);
}

// Torque against the motor: an elastic bristle that slips at the dry friction, and smooth parts.
double ImpactTool::friction(double t, const StateVector &y, StateVector &d) const {
    const ImpactParams &p = params;
    const double w = p.ratio * (y[SPINDLE_SPEED] - y[ARM_SPEED]);
    const double angle = p.ratio * (y[SPINDLE] - y[ARM]);
    const double limit = dry_level(w, y[CURRENT]), bent = bristle_nm_per_rad_ * y[BRISTLE];
    double torque = std::clamp(bent + bristle_nm_s_ * w, -limit, limit);
    d[BRISTLE] = (torque - bent) / bristle_nm_s_;
    torque += p.viscous_nm_s_per_rad * w + p.quadratic_nm_s2 * w * std::abs(w) +
              p.directional_viscous_nm_s * std::abs(w);
    if (p.extra_viscous_nm_s != 0.0) {
        torque += p.extra_viscous_nm_s * w * power_law(w, p.reference_rad_s, p.viscous_power - 1.0);
    }
    if (p.grease_nm_s != 0.0) {
        torque += p.grease_nm_s * std::exp(-t / p.grease_s) * w;
    }
    if (p.cogging_nm != 0.0) {
        const double phase = p.cogging_per_rev * angle + p.cogging_phase_rad;
        torque += p.cogging_nm * (std::sin(phase) + p.cogging_second * std::sin(2.0 * phase));
    }
    if (p.eccentricity_nm != 0.0) {
        torque += p.eccentricity_nm * std::sin(angle / p.ratio + p.eccentricity_phase_rad);
    }
    d[LOST_J] += torque * w - bent * d[BRISTLE];
    return torque;
}

// Force of the spring, with a progressive part, and one of coils that touch.
double ImpactTool::spring_force(double travel) const {
    const ImpactParams &p = params;
    const double force = p.spring_preload_n + p.spring_rate_n_per_m * travel +
                         p.spring_square_n_per_m2 * travel * travel;
    return p.u_coil_bind_n_per_m == 0.0
               ? force
               : force + p.u_coil_bind_n_per_m * std::max(travel - p.u_coil_bind_at_m, 0.0);
}

// Dry friction of the hammer in its housing, where it is retracted beyond a place.
double ImpactTool::hammer_drag(const StateVector &y, double travel) const {
    const ImpactParams &p = params;
    if (p.u_housing_drag_nm == 0.0) {
        return 0.0;
    }
    return p.u_housing_drag_nm * std::tanh(y[HAMMER_SPEED] / 0.5) /
           (1.0 + std::exp(-(travel - p.u_drag_from_m) / p.u_drag_width_m));
}

// Torque of the groove's friction against a sliding speed, from the axial force of the ball.
double ImpactTool::groove_rub(double force, double q_rate) const {
    const ImpactParams &p = params;
    const double lead = p.groove_lead_m_per_rad / p.groove_radius_m;
    const double arm = p.groove_radius_m * std::sqrt(1.0 + lead * lead);  // r / cos(atan(l / r))
    const double slow_share =
        p.groove_static != 0.0 ? p.groove_static * std::exp(-std::abs(q_rate) / 10.0) : 0.0;
    return p.groove_friction * (1.0 + slow_share) * std::abs(force) * arm *
           std::tanh(q_rate / p.groove_knee_rad_s);
}

// Accelerations of spindle and hammer: the groove couples both by q = spindle - hammer, and the
// hammer's mass follows x(q).
void ImpactTool::hammer_rates(const StateVector &y, double shaft_nm, const Push &push,
                              StateVector &d) {
    const ImpactParams &p = params;
    const double q_rate = y[SPINDLE_SPEED] - y[HAMMER_SPEED], m = p.hammer_mass_kg;
    const Groove g = groove(y[SPINDLE] - y[HAMMER]);
    const double rotor = p.ratio * p.ratio * p.inertia_kg_m2;
    double shaft_inertia = rotor + p.output_inertia_kg_m2, drive = p.ratio * shaft_nm;
    double arm_mass = 0.0, arm_nm = 0.0, coupled = 0.0;
    if (p.u_arm_inertia_kg_m2 > 0.0) {  // the housing turns against the operator's arm
        coupled = p.ratio * (p.ratio - 1.0) * p.inertia_kg_m2;
        arm_mass = p.u_arm_inertia_kg_m2 + (p.ratio - 1.0) * (p.ratio - 1.0) * p.inertia_kg_m2;
        arm_nm = -drive - p.u_arm_nm_s_per_rad * y[ARM_SPEED] - p.u_arm_nm_per_rad * y[ARM];
        shaft_inertia -= coupled * coupled / arm_mass;
        drive += coupled * arm_nm / arm_mass;
    }
    const double spring = spring_force(g.travel), drag = hammer_drag(y, g.travel);
    const Contact stop = axial(g, g.slope * q_rate);
    const double held = spring + stop.stored_n + stop.damping_n + m * g.bend * q_rate * q_rate;
    const double hammer = p.hammer_inertia_kg_m2, lug_nm = push.hammer_nm + drag;
    const double mobility = 1.0 / shaft_inertia + 1.0 / hammer;
    const double q_mass = 1.0 + m * g.slope * g.slope * mobility;
    double rub = 0.0;
    double q_acc = (drive / shaft_inertia + lug_nm / hammer - g.slope * held * mobility) / q_mass;
    if (p.groove_friction != 0.0) {
        rub = groove_rub(held + m * g.slope * q_acc, q_rate);
        q_acc -= rub * mobility / q_mass;
    }
    const double ball_nm = g.slope * (held + m * g.slope * q_acc) + rub;
    d[SPINDLE_SPEED] = (drive - ball_nm) / shaft_inertia;
    d[HAMMER_SPEED] = (ball_nm - lug_nm) / hammer;
    d[SPINDLE] = y[SPINDLE_SPEED];
    d[HAMMER] = y[HAMMER_SPEED];
    if (arm_mass > 0.0) {
        d[ARM_SPEED] = (arm_nm + coupled * d[SPINDLE_SPEED]) / arm_mass;
        d[ARM] = y[ARM_SPEED];
    }
    d[LOST_J] += push.loss_w + rub * q_rate + drag * y[HAMMER_SPEED] +
                 stop.damping_n * g.slope * q_rate +
                 p.u_arm_nm_s_per_rad * y[ARM_SPEED] * y[ARM_SPEED];
}

StateVector ImpactTool::rates(double t, const StateVector &y) {
    StateVector d{};
    electric_rates(t, y, d);
    joint_rates(y, d);
    const Push push = lug_push(y);
    d[ANVIL_SPEED] += push.hammer_nm / params.anvil_inertia_kg_m2;
    const double against = friction(t, y, d);
    hammer_rates(y, saturated_k(y[CURRENT]) * y[CURRENT] - against, push, d);
    return d;
}

// One step of length h; false where its error is above the allowed one.
bool ImpactTool::try_step(double h, StateVector &next, StateVector &last, double &error) {
    if (!first_known_) {
        first_ = rates(time_s, state);
        first_known_ = true;
    }
    StateVector y{};
    for (std::size_t n = 0; n < STATE_COUNT; ++n) {
        y[n] = state[n] + 0.5 * h * first_[n];
    }
    const StateVector second = rates(time_s + 0.5 * h, y);
    for (std::size_t n = 0; n < STATE_COUNT; ++n) {
        y[n] = state[n] + 0.75 * h * second[n];
    }
    const StateVector third = rates(time_s + 0.75 * h, y);
    for (std::size_t n = 0; n < STATE_COUNT; ++n) {
        next[n] = state[n] + h / 9.0 * (2.0 * first_[n] + 3.0 * second[n] + 4.0 * third[n]);
    }
    last = rates(time_s + h, next);
    error = 0.0;
    for (std::size_t n = 0; n < CONTROLLED_COUNT; ++n) {
        const double off =
            h / 72.0 * (-5.0 * first_[n] + 6.0 * second[n] + 8.0 * third[n] - 9.0 * last[n]);
        error = std::max(error, std::abs(off) / ALLOWED[n]);
    }
    error /= params.tolerance;
    return error <= 1.0 || h <= SHORTEST_S;
}

// Whether the lugs' place at y differs from the one that the step has assumed.
bool ImpactTool::place_changes(const StateVector &y) const {
    const double travel = groove(y[SPINDLE] - y[HAMMER]).travel;
    if (place_ == LugPlace::GAP) {
        return travel >= height(lug_);
    }
    if (place_ == LugPlace::CLEAR) {
        return travel < height(lug_);
    }
    const double turned = y[HAMMER] - y[ANVIL];
    return travel >= height(lug_) || turned <= flank(lug_) ||
           turned >= flank(lug_) + params.lug_overlap_rad;
}

// The lugs' place at y, by retraction and angle.
void ImpactTool::move_place(const StateVector &y) {
    const double travel = groove(y[SPINDLE] - y[HAMMER]).travel;
    const double turned = y[HAMMER] - y[ANVIL];
    if (travel >= height(lug_)) {
        place_ = LugPlace::CLEAR;
        return;
    }
    while (turned > flank(lug_) + params.lug_overlap_rad) {
        ++lug_;
    }
    while (turned <= flank(lug_ - 1)) {
        --lug_;
    }
    if (turned > flank(lug_)) {
        place_ = LugPlace::OVER;
    } else if (turned < flank(lug_ - 1) + params.lug_overlap_rad) {
        --lug_;
        place_ = LugPlace::OVER;
    } else {
        place_ = LugPlace::GAP;
    }
}

// Notes the touch of a flank by the number of the gap that the hammer is in, once for each gap.
void ImpactTool::note_touch(const StateVector &y) {
    const double turned = y[HAMMER] - y[ANVIL];
    const bool touch = place_ == LugPlace::GAP &&
                       (turned > flank(lug_) || turned < flank(lug_ - 1) + params.lug_overlap_rad);
    if (touch && !touching_ && lug_ != last_lug_) {
        if (!blows.empty()) {
            blows.back().peak_nm = peak_nm_;
        }
        peak_nm_ = 0.0;
        last_lug_ = lug_;
        const double head = (params.coupler_nm_per_rad > 0.0 ? y[BIT] : y[ANVIL]) - y[TWIST];
        blows.push_back({time_s, static_cast<double>(lug_), y[HAMMER_SPEED] - y[ANVIL_SPEED], 0.0,
                         head, motor_angle()});
    }
    touching_ = touch;
}

// Charge, heat and events after a step.
void ImpactTool::slow_rates(double h) {
    const ImpactParams &p = params;
    if (time_s >= slow.gate_until_s) {
        slow.gate = !slow.gate;
        slow.gate_until_s =
            time_s + (slow.gate ? p.gate_on_s : p.gate_off_s) * (0.5 + random.uniform());
    }
    const double duty = coast_ ? 0.0 : duty_begin_ + duty_rate_ * (time_s - duty_from_s_);
    const double i = state[CURRENT], bus_a = duty * i;
    slow.charge_c += h * bus_a;
    slow.polarisation_v +=
        h * (p.polarisation_ohm * bus_a - slow.polarisation_v) / p.polarisation_s;
    slow.polarisation2_v +=
        h * (p.polarisation2_ohm * bus_a - slow.polarisation2_v) / p.polarisation2_s;
    const double ohm = p.resistance_ohm * (1.0 + COPPER_PER_KELVIN * slow.winding_kelvin);
    const double out = (slow.winding_kelvin - slow.housing_kelvin) / p.heating_cooling_s;
    slow.winding_kelvin += h * (p.heating_kelvin_per_joule * i * i * ohm - out);
    slow.housing_kelvin += h * p.heating_housing_share * out;
    slow.joint_heat += h * (std::abs(joint_nm_ * slip_rate_) - slow.joint_heat / p.u_heat_s);
    resistance_ = ohm + p.bridge_resistance_ohm + (slow.gate ? p.u_brush_ohm : 0.0);
    if (p.extra_ohm != 0.0) {
        resistance_ += p.extra_ohm * power_law(i, p.reference_a, p.extra_ohm_power);
    }
    open_circuit_v_ = p.voltage_v - p.droop_volt_per_coulomb * slow.charge_c - slow.polarisation_v -
                      slow.polarisation2_v;
    source_ohm_ = p.supply_resistance_ohm + (slow.gate ? p.u_contact_ohm : 0.0);
    if (p.extra_source_ohm != 0.0) {
        source_ohm_ += p.extra_source_ohm * power_law(bus_a, p.reference_a, p.source_power);
    }
    k_ = p.torque_constant_nm_per_a * (1.0 - (slow.gate ? p.u_flux_loss : 0.0));
    wander_nm_ =
        p.u_wander_nm != 0.0 ? p.u_wander_nm * std::sin(TURN * time_s / p.u_wander_s) : 0.0;
}

void ImpactTool::after_step(double h, const StateVector &before) {
    find_edges(h, params.ratio * (before[SPINDLE] - params.hammer_start_rad - before[ARM]),
               motor_angle());
    time_s += h;
    ++steps;
    if (coast_ && before[CURRENT] * state[CURRENT] < 0.0) {
        state[CURRENT] = 0.0;
        first_known_ = false;
    }
    peak_nm_ = std::max(peak_nm_, std::abs(joint_nm_));
    if (place_changes(state)) {
        move_place(state);
        first_known_ = false;
    }
    note_touch(state);
    slow_rates(h);
}

void ImpactTool::advance(double end_s, double duty_begin, double duty_end, bool coast) {
    coast_ = coast;
    duty_begin_ = duty_begin;
    duty_from_s_ = time_s;
    duty_rate_ = end_s > time_s ? (duty_end - duty_begin) / (end_s - time_s) : 0.0;
    first_known_ = false;
    StateVector next{}, last{};
    while (time_s < end_s - 1e-12) {
        const double h = std::min(step_s_, end_s - time_s);
        double error = 0.0;
        const bool good = try_step(h, next, last, error);
        const double factor = std::clamp(0.85 / std::cbrt(error + 1e-9), 0.2, 2.5);
        if (good && h > EVENT_S && place_changes(next)) {
            step_s_ = std::max(0.4 * h, 0.99 * EVENT_S);
            continue;
        }
        if (!good) {
            step_s_ = std::max(h * factor, SHORTEST_S);
            continue;
        }
        const StateVector before = state;
        state = next;
        first_ = last;
        after_step(h, before);
        if (!(std::abs(state[SPINDLE_SPEED]) < 1e5)) {
            return;  // diverged
        }
        // a step cut by the end of the row does not shorten the next one
        step_s_ = std::min(h < step_s_ ? std::max(h * factor, step_s_) : h * factor, params.step_s);
    }
    time_s = end_s;
}

double ImpactTool::hall_angle(double angle) const {
    return params.hall_eccentricity_rad == 0.0
               ? angle
               : angle + params.hall_eccentricity_rad *
                             std::sin(angle + params.hall_eccentricity_phase_rad);
}

double ImpactTool::edge_angle(long index) const {
    return params.hall_offset_rad + static_cast<double>(index) * TURN / params.hall_edges;
}

// Edges passed in a step, located by linear interpolation; in reverse they are late by a hysteresis
// of 5 mrad.
void ImpactTool::find_edges(double h, double from, double to) {
    if (params.hall_edges <= 0.0 || !(std::abs(to - from) < 1.0)) {
        return;
    }
    const double a0 = hall_angle(from), a1 = hall_angle(to);
    const auto keep = [&](double at, int direction) {
        const double part = a1 != a0 ? std::clamp((at - a0) / (a1 - a0), 0.0, 1.0) : 1.0;
        const double jitter =
            params.hall_jitter_s > 0.0 ? params.hall_jitter_s * random.normal() : 0.0;
        missed_ = params.hall_dropout > 0.0 && random.uniform() < params.hall_dropout;
        if (!missed_) {
            edges.push_back({time_s + part * h + jitter, direction});
        }
    };
    while (a1 >= edge_angle(edge_index_ + 1)) {
        ++edge_index_;
        keep(edge_angle(edge_index_), 1);
    }
    while (a1 < edge_angle(edge_index_) - 0.005) {
        keep(edge_angle(edge_index_) - 0.005, -1);
        --edge_index_;
    }
}

// Energy of currents, inertias, hammer, spring, joint and contacts.
double ImpactTool::stored_energy() const {
    const ImpactParams &p = params;
    const StateVector &y = state;
    const double q = y[SPINDLE] - y[HAMMER], q_rate = y[SPINDLE_SPEED] - y[HAMMER_SPEED];
    const Groove g = groove(q);
    const double rotor = y[ARM_SPEED] + p.ratio * (y[SPINDLE_SPEED] - y[ARM_SPEED]);
    const auto kinetic = [](double inertia, double speed) { return 0.5 * inertia * speed * speed; };
    double energy = kinetic(p.inductance_h, y[CURRENT]) + kinetic(p.inertia_kg_m2, rotor) +
                    kinetic(p.output_inertia_kg_m2, y[SPINDLE_SPEED]) +
                    kinetic(p.hammer_inertia_kg_m2, y[HAMMER_SPEED]) +
                    kinetic(p.hammer_mass_kg, g.slope * q_rate) +
                    kinetic(p.anvil_inertia_kg_m2, y[ANVIL_SPEED]);
    energy += p.spring_preload_n * g.travel + kinetic(p.spring_rate_n_per_m, g.travel) +
              p.spring_square_n_per_m2 * std::pow(g.travel, 3.0) / 3.0 +
              kinetic(p.joint_nm_per_rad, y[TWIST]) + kinetic(bristle_nm_per_rad_, y[BRISTLE]);
    if (p.coupler_nm_per_rad > 0.0) {
        energy += kinetic(p.coupler_nm_per_rad, y[ANVIL] - y[BIT]) +
                  kinetic(std::max(p.coupler_inertia_kg_m2, 1e-7), y[BIT_SPEED]);
    }
    energy += kinetic(p.u_arm_inertia_kg_m2, y[ARM_SPEED]) + kinetic(p.u_arm_nm_per_rad, y[ARM]);
    return energy + contact_energy();
}

// Energy of the elastic parts of the contacts.
double ImpactTool::contact_energy() const {
    const auto elastic = [this](double depth) {
        return depth > 0.0 ? 0.5 * params.contact_stiffness_n_per_m * depth * depth : 0.0;
    };
    const double turned = state[HAMMER] - state[ANVIL], x = travel_m(), r = params.lug_radius_m;
    const double e = params.vertex_rad, q = params.travel_rad;
    double energy = elastic(x - params.groove_lead_m_per_rad * (std::sqrt(q * q + e * e) - e));
    if (place_ == LugPlace::GAP) {
        energy += elastic(r * (turned - flank(lug_))) +
                  elastic(r * (flank(lug_ - 1) + params.lug_overlap_rad - turned));
    }
    return energy + (place_ == LugPlace::OVER ? elastic(height(lug_) - x) : 0.0);
}

}  // namespace truth
