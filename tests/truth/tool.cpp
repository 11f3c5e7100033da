// The equations of motion of a generated tool and their integration between the switching instants
// of the bridge.
#include "tool.hpp"

#include <algorithm>
#include <cmath>

namespace truth {
namespace {

constexpr double TURN = 6.283185307179586;
constexpr double COPPER_PER_KELVIN = 0.00393;  // resistivity of annealed copper at 20 C, IEC 60028

double sign(double x) {
    return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : 0.0);
}

// (|x| / reference)^power, constant below a fiftieth of the reference, since a negative power
// diverges at 0; 1 for the power 0.
double power_law(double x, double reference, double power) {
    return power == 0.0 ? 1.0 : std::pow(std::max(std::abs(x) / reference, 0.02), power);
}

// Friction that grows with speed: viscous, quadratic, one-sided, each with its power.
double drag_torque(const Params &p, double w) {
    double torque =
        p.viscous_nm_s_per_rad * w + p.quadratic_nm_s2 * w * std::abs(w) *
                                         power_law(w, p.reference_rad_s, p.quadratic_power - 2.0);
    torque += p.directional_viscous_nm_s * std::abs(w) *
              power_law(w, p.reference_rad_s, p.directional_power - 1.0);
    if (p.extra_viscous_nm_s != 0.0) {
        torque += p.extra_viscous_nm_s * w * power_law(w, p.reference_rad_s, p.viscous_power - 1.0);
    }
    return torque;
}

// z' = w - |w| z / z_ss solved exactly over h at constant speed; |z| does not exceed z_ss.
void advance_bristle(Bristle &bristle, double speed, double h, double limit_rad) {
    if (limit_rad <= 1e-12) {
        bristle.deflection_rad = 0.0;
        return;
    }
    const double target = sign(speed) * limit_rad;
    const double keep = std::exp(-std::abs(speed) * h / limit_rad);
    bristle.deflection_rad =
        std::clamp(target + (bristle.deflection_rad - target) * keep, -limit_rad, limit_rad);
}

// LuGre torque (Canudas de Wit 1995): spring, and a damping that decreases with the sliding speed.
double bristle_torque(const Bristle &bristle, double speed, double stiffness, double damping,
                      double limit_rad) {
    if (limit_rad <= 1e-12) {
        return 0.0;
    }
    const double rate = speed - std::abs(speed) * bristle.deflection_rad / limit_rad;
    const double fade = 1.0 / (1.0 + speed * speed);
    return stiffness * bristle.deflection_rad + damping * fade * rate;
}

}  // namespace

double RandomStream::uniform() {
    state_ += 0x9E3779B97F4A7C15ULL;
    std::uint64_t x = state_;
    x = (x ^ (x >> 30U)) * 0xBF58476D1CE4E5B9ULL;
    x = (x ^ (x >> 27U)) * 0x94D049BB133111EBULL;
    x ^= x >> 31U;
    return (static_cast<double>(x >> 11U) + 0.5) / 9007199254740992.0;
}

double RandomStream::normal() {
    const double radius = std::sqrt(-2.0 * std::log(uniform()));
    return radius * std::cos(TURN * uniform());
}

double AngleTorque::at(double angle_rad) const {
    const double turns = angle_rad / (step_rad * count);
    const double place = (turns - std::floor(turns)) * count;
    const int below = std::min(static_cast<int>(place), count - 1);
    const double from = torque_nm[below], to = torque_nm[(below + 1) % count];
    return from + (to - from) * (place - below);
}

void Tool::start() {
    const double squared = params.ratio * params.ratio;
    const double pendulum =
        params.pendulum_mass_kg * params.pendulum_length_m * params.pendulum_length_m;
    state = State{};
    sums = Sums{};
    edges.clear();
    commands.clear();
    random = RandomStream(static_cast<std::uint64_t>(params.seed));
    out_inertia_ =
        (params.output_inertia_kg_m2 + pendulum) / squared + params.coupler_inertia_kg_m2;
    two_masses_ = (params.coupler_nm_per_rad > 0.0 || params.play_rad > 0.0) && out_inertia_ > 0.0;
    inertia_ = params.inertia_kg_m2 + (two_masses_ ? 0.0 : out_inertia_);
    stiffness_ = std::max(params.coulomb_nm, 1e-4) / params.bristle_rad;
    load_stiffness_ = std::max(params.load_reference_nm, 1e-4) / params.bristle_rad;
    // A stiff coupling needs steps of at most a thirtieth of its period.
    const double coupling_rad_s =
        two_masses_ ? std::sqrt(coupling_rate() * (1.0 / out_inertia_ + 1.0 / inertia_)) : 1.0;
    step_s_ = std::min(params.step_s, 0.2 / coupling_rad_s);
    state.bus_v = params.voltage_v;
    state.gate_until_s = params.gate_off_s * (0.5 + random.uniform());
    state.ripple_rad = TURN * random.uniform();
    state.edge_index = static_cast<long>(
        std::floor((hall_angle(0.0) - params.hall_offset_rad) * params.hall_edges / TURN));
    while (params.hall_edges > 0.0 && edge_angle(state.edge_index + 1) <= hall_angle(0.0)) {
        ++state.edge_index;
    }
    while (params.hall_edges > 0.0 && edge_angle(state.edge_index) > hall_angle(0.0)) {
        --state.edge_index;
    }
}

void Tool::begin_period(double period_s, const Drive &drive) {
    drive_ = drive;
    load_at_shaft_nm_ = std::abs(drive.load_nm) / params.ratio;
    damping_ = 2.0 * params.bristle_damping * std::sqrt(stiffness_ * inertia_);
    load_damping_ =
        2.0 * params.bristle_damping * std::sqrt(load_stiffness_ * (inertia_ + out_inertia_));
    move_to_edge(state.edge_index);
    slow_states(period_s);
    if (state.gate) {
        drive_.duty *= 1.0 - params.u_glitch;
    }
    plan_spans(period_s);
}

void Tool::move_gate() {
    if (state.time_s < state.gate_until_s) {
        return;
    }
    state.gate = !state.gate;
    state.gate_until_s = state.time_s + (state.gate ? params.gate_on_s : params.gate_off_s) *
                                            (0.5 + random.uniform());
}

// States that change little within a PWM period: heat, charge, the random events, and the rate of
// the random ripple (a random walk around 1 with a time constant of 50 ms).
void Tool::slow_states(double period_s) {
    move_gate();
    const double bus_a = drive_.coast ? 0.0 : drive_.duty * state.current_a;
    state.charge_c += bus_a * period_s;
    state.polarisation_v +=
        (params.polarisation_ohm * bus_a - state.polarisation_v) * period_s / params.polarisation_s;
    state.polarisation2_v += (params.polarisation2_ohm * bus_a - state.polarisation2_v) * period_s /
                             params.polarisation2_s;
    resistance_ = params.resistance_ohm * (1.0 + COPPER_PER_KELVIN * state.winding_kelvin);
    const double heat_w = state.current_a * state.current_a * resistance_;
    const double to_housing =
        (state.winding_kelvin - state.housing_kelvin) / params.heating_cooling_s;
    state.winding_kelvin += period_s * (params.heating_kelvin_per_joule * heat_w - to_housing);
    state.housing_kelvin += period_s * params.heating_housing_share * to_housing;
    resistance_ +=
        params.bridge_resistance_ohm + (state.gate ? params.u_brush_ohm : 0.0) + extra_resistance();
    open_circuit_v_ = params.voltage_v - params.droop_volt_per_coulomb * state.charge_c -
                      state.polarisation_v - state.polarisation2_v;
    if (drive_.extra_supply_v != 0.0) {
        open_circuit_v_ += drive_.extra_supply_v;
    }
    source_ohm_ = params.supply_resistance_ohm + (state.gate ? params.u_contact_ohm : 0.0) +
                  params.u_supply_square_ohm_per_a * std::abs(bus_a);
    if (params.extra_source_ohm != 0.0) {
        source_ohm_ +=
            params.extra_source_ohm * power_law(bus_a, params.reference_a, params.source_power);
    }
    if (drive_.bus_v > 0.0) {
        open_circuit_v_ = drive_.bus_v;
        source_ohm_ = 0.0;
    }
    k_ = params.torque_constant_nm_per_a * (1.0 - (state.gate ? params.u_flux_loss : 0.0));
    state.ripple_rate += (1.0 - state.ripple_rate) * period_s / 0.05 +
                         params.u_ripple_wander * std::sqrt(period_s / 0.05) *
                             (params.u_ripple_nm != 0.0 ? random.normal() : 0.0);
}

// Leg A has a pulse centred in the period; leg B is high in reverse, so that the motor voltage is
// (pulse - 1) Vs.
void Tool::plan_spans(double period_s) {
    const double t0 = state.time_s, end = t0 + period_s;
    span_ = 0;
    span_count_ = 1;
    if (drive_.coast) {
        spans_[0] = {end, -1, -1};
        return;
    }
    const double duty = std::clamp(drive_.duty, -1.0, 1.0);
    const int leg_b = duty < 0.0 ? 1 : 0;
    const double width = period_s * (duty < 0.0 ? 1.0 + duty : duty);
    const double rise = t0 + 0.5 * (period_s - width), fall = rise + width;
    if (std::abs(duty) >= 1.0 || duty == 0.0) {
        spans_[0] = {end, duty >= 1.0 ? 1 : 0, leg_b};
        return;
    }
    const double current = std::abs(state.current_a);
    const double dead =
        drive_.dead_s +
        params.dead_time_s *
            (params.dead_knee_a > 0.0 ? current / (current + params.dead_knee_a) : 1.0);
    double marks[5] = {rise - dead, rise + dead, fall - dead, fall + dead, end};
    for (double &mark : marks) {
        mark = std::clamp(mark, t0, end);
    }
    std::sort(marks, marks + 5);
    span_count_ = 0;
    double from = t0;
    for (const double mark : marks) {
        if (mark - from < 1e-12) {
            continue;
        }
        const double middle = 0.5 * (from + mark);
        const bool floating = std::abs(middle - rise) < dead || std::abs(middle - fall) < dead;
        spans_[span_count_++] = {mark, floating ? -1 : (middle > rise && middle < fall ? 1 : 0),
                                 leg_b};
        from = mark;
    }
}

bool Tool::advance(double cut_s) {
    while (span_ < span_count_) {
        const Span &span = spans_[span_];
        const double stop = std::min(span.end_s, cut_s);
        const double length = stop - state.time_s;
        if (length > 1e-13) {
            const int count = std::max(1, static_cast<int>(std::ceil(length / step_s_ - 1e-9)));
            for (int n = 0; n < count; ++n) {
                step(length / count, span.leg_a, span.leg_b);
            }
        }
        state.time_s = stop;
        if (span.end_s > cut_s) {
            return true;
        }
        ++span_;
    }
    return state.time_s >= cut_s;
}

// Sign of the bus voltage at the motor: -1, 0, 1. The diodes of a floating leg conduct by the sign
// of the current.
int Tool::bridge_sign(int leg_a, int leg_b) const {
    const double current = state.current_a;
    const int a = leg_a >= 0 ? leg_a : (current > 0.0 ? 0 : 1);
    const int b = leg_b >= 0 ? leg_b : (current > 0.0 ? 1 : 0);
    return a - b;
}

double Tool::saturated_k(double current_a) const {
    if (params.saturation_a <= 0.0) {
        return k_;
    }
    const double x = std::sqrt(3.0) * std::abs(current_a) / params.saturation_a;
    return x < 1e-6 ? k_ : k_ * std::tanh(x) / x;
}

// Inductance of a winding with saturation: the extra part decreases with the current.
double Tool::inductance(double current_a) const {
    if (params.extra_inductance_h == 0.0) {
        return params.inductance_h;
    }
    const double x = params.inductance_knee_a > 0.0 ? current_a / params.inductance_knee_a : 0.0;
    return params.inductance_h + params.extra_inductance_h / (1.0 + x * x);
}

// A resistance that rises with the current by a power.
double Tool::extra_resistance() const {
    return params.extra_ohm == 0.0
               ? 0.0
               : params.extra_ohm *
                     power_law(state.current_a, params.reference_a, params.extra_ohm_power);
}

// Largest dry friction of the motor.
double Tool::dry_level(double speed) const {
    const double p = params.stribeck_rad_s;
    const double near = params.stribeck_power == 2.0
                            ? speed * speed / (p * p)
                            : std::pow(std::abs(speed) / p, params.stribeck_power);
    const double breakaway =
        params.breakaway_nm != 0.0 ? params.breakaway_nm * std::exp(-near) : 0.0;
    const double side =
        state.motor_bristle.deflection_rad >= 0.0 ? params.forward_nm : params.backward_nm;
    const double load = load_at_shaft_nm_ * power_law(load_at_shaft_nm_, params.load_reference_nm,
                                                      params.load_friction_power - 1.0);
    double level = params.coulomb_nm + breakaway + side + params.load_friction * load;
    if (params.power_coulomb_nm != 0.0) {
        level += params.power_coulomb_nm *
                 power_law(speed, params.reference_rad_s, params.coulomb_power);
    }
    if (state.gate) {
        level += params.u_load_nm;
    }
    if (drive_.extra_coulomb_nm != 0.0) {
        level += drive_.extra_coulomb_nm;
    }
    if (params.u_wander_nm != 0.0) {
        level += params.u_wander_nm * std::sin(TURN * state.time_s / params.u_wander_s);
    }
    if (params.u_tight_nm != 0.0) {
        const double from_spot = std::remainder(
            state.angle_rad / params.ratio - params.u_tight_at_rad, params.u_tight_every_rad);
        const double x = from_spot / params.u_tight_width_rad;
        level += params.u_tight_nm * std::exp(-x * x);
    }
    return std::max(level, 0.0);
}

// Torques on the shaft that are smooth in speed, angle and time.
double Tool::smooth_torque() const {
    const Params &p = params;
    const double w = state.speed_rad_s, angle = state.angle_rad;
    double torque = drag_torque(p, w);
    if (p.grease_nm_s != 0.0) {
        const double fresh = (1.0 - p.grease_tail) * std::exp(-state.time_s / p.grease_s) +
                             p.grease_tail * std::exp(-state.time_s / p.grease_tail_s);
        torque += p.grease_nm_s * fresh * w;
    }
    if (p.cogging_nm != 0.0) {
        const double phase = p.cogging_per_rev * angle + p.cogging_phase_rad;
        torque += p.cogging_nm * (std::sin(phase) + p.cogging_second * std::sin(2.0 * phase) +
                                  p.cogging_third * std::sin(3.0 * phase));
    }
    if (p.eccentricity_nm != 0.0) {
        const double phase = angle / p.ratio + p.eccentricity_phase_rad;
        torque +=
            p.eccentricity_nm * (std::sin(phase) + p.eccentricity_second * std::sin(2.0 * phase));
    }
    if (roughness.count > 0) {
        torque += roughness.at(angle);
    }
    if (p.u_torque_hum_nm != 0.0) {
        torque += p.u_torque_hum_nm * std::sin(TURN * p.u_torque_hz * state.time_s);
    }
    if (p.u_ripple_nm != 0.0) {
        torque += p.u_ripple_nm * std::sin(state.ripple_rad);
    }
    return torque;
}

// With play alone the flanks have the stiffness of steel teeth: 400 Hz with the output side.
double Tool::coupling_rate() const {
    return params.coupler_nm_per_rad > 0.0 ? params.coupler_nm_per_rad : out_inertia_ * 6.3e6;
}

// Torque of the spring between motor and output side, both referred to the motor shaft; 0 within
// the play. It is computed at the middle of the step, so that it creates no energy and has no phase
// error.
double Tool::coupling_torque(double h) const {
    const double half = 0.5 * params.play_rad * params.ratio;
    const double twist = state.angle_rad - state.out_angle_rad +
                         0.5 * h * (state.speed_rad_s - state.out_speed_rad_s);
    const double bent = twist > half ? twist - half : (twist < -half ? twist + half : 0.0);
    if (bent == 0.0) {
        return 0.0;
    }
    const double rate = coupling_rate();
    const double damping = 2.0 * params.coupler_damping_ratio * std::sqrt(rate * out_inertia_);
    return rate * bent * (1.0 + params.coupler_cubic_per_rad2 * bent * bent) +
           damping * (state.speed_rad_s - state.out_speed_rad_s);
}

void Tool::step_output(double h) {
    State &s = state;
    const double limit = load_at_shaft_nm_ / load_stiffness_;
    const double speed = two_masses_ ? s.out_speed_rad_s : s.speed_rad_s;
    advance_bristle(s.load_bristle, speed, 0.5 * h, limit);
    double torque = bristle_torque(s.load_bristle, speed, load_stiffness_, load_damping_, limit);
    if (params.pendulum_mass_kg > 0.0) {
        const double angle =
            (two_masses_ ? s.out_angle_rad : s.angle_rad) / params.ratio - params.pendulum_zero_rad;
        torque += params.pendulum_mass_kg * 9.81 * params.pendulum_length_m * std::sin(angle) /
                  params.ratio;
    }
    s.load_bristle.torque_nm = torque;
    if (!two_masses_) {
        return;
    }
    coupling_nm_ = coupling_torque(h);
    const double gained = h * (coupling_nm_ - torque) / out_inertia_,
                 mean = s.out_speed_rad_s + 0.5 * gained;
    s.out_speed_rad_s += gained;
    s.out_angle_rad += h * mean;
    sums.load_j += h * torque * mean;
}

// L i' = v - R i - k w, J w' = k i - T by the implicit midpoint rule; T and the brushes at the
// start of the step.
void Tool::step_shaft(double h, double volts, bool conducting) {
    State &s = state;
    const double k = saturated_k(s.current_a);
    const double limit = dry_level(s.speed_rad_s) / stiffness_;
    advance_bristle(s.motor_bristle, s.speed_rad_s, 0.5 * h, limit);
    const double smooth = smooth_torque();
    const double friction =
        smooth + bristle_torque(s.motor_bristle, s.speed_rad_s, stiffness_, damping_, limit);
    const double against = friction + (two_masses_ ? coupling_nm_ : s.load_bristle.torque_nm);
    const double drop = params.brush_drop_v != 0.0
                            ? params.brush_drop_v * sign(s.current_a) *
                                  (1.0 - std::exp(-std::abs(s.current_a) / params.brush_knee_a))
                            : 0.0;
    const double i0 = s.current_a, w0 = s.speed_rad_s;
    double i1 = 0.0;
    const double a = 0.5 * h / inductance(s.current_a), c = 0.5 * h / inertia_;
    if (conducting) {
        const double i_mid = (i0 + a * (volts - drop - k * (w0 - c * against))) /
                             (1.0 + a * resistance_ + a * c * k * k);
        i1 = 2.0 * i_mid - i0;
    }
    if (params.current_source_a > 0.0) {
        // the mean over the step is the current of the source
        i1 = 2.0 * params.current_source_a * drive_.duty - i0;
    }
    const double i_mid = 0.5 * (i0 + i1);
    s.current_a = params.current_source_a > 0.0 ? i_mid : i1;
    s.speed_rad_s = w0 + 2.0 * c * (k * i_mid - against);
    const double w_mid = 0.5 * (w0 + s.speed_rad_s);
    s.angle_rad += h * w_mid;
    advance_bristle(s.motor_bristle, s.speed_rad_s, 0.5 * h, limit);
    s.motor_bristle.torque_nm = friction - smooth;
    s.ripple_rad += h * w_mid * params.u_ripple_per_rev * s.ripple_rate;
    sums.copper_j += h * (resistance_ * i_mid * i_mid + drop * i_mid);
    sums.friction_j += h * friction * w_mid;
    if (!two_masses_) {
        sums.load_j += h * s.load_bristle.torque_nm * w_mid;
        s.out_speed_rad_s = s.speed_rad_s;
        s.out_angle_rad = s.angle_rad;
        advance_bristle(s.load_bristle, s.speed_rad_s, 0.5 * h,
                        load_at_shaft_nm_ / load_stiffness_);
    }
}

// Voltage drop over the source resistance; the bus capacitor smooths the ripple of the switching.
void Tool::step_bus(double h, double bus_a) {
    if (source_ohm_ <= 0.0) {
        state.bus_v = open_circuit_v_;
        return;
    }
    const double target = open_circuit_v_ - source_ohm_ * bus_a;
    state.bus_v = target + (state.bus_v - target) * std::exp(-h / params.bus_filter_s);
}

void Tool::step(double h, int leg_a, int leg_b) {
    State &s = state;
    const double t0 = s.time_s, angle0 = s.angle_rad, i0 = s.current_a;
    const bool floating = leg_a < 0;
    int way = bridge_sign(leg_a, leg_b);
    bool conducting = true;
    if (floating && i0 == 0.0) {
        const double emf = k_ * s.speed_rad_s;
        const double high = leg_b < 0 ? s.bus_v : s.bus_v * (1 - leg_b),
                     low = high - s.bus_v * (leg_b < 0 ? 2.0 : 1.0);
        conducting = emf > high || emf < low;
        way = emf > high ? (leg_b == 1 ? 0 : 1) : (leg_b == 0 ? 0 : -1);
    }
    step_output(h);
    step_shaft(h, way * s.bus_v, conducting);
    if (floating && i0 * s.current_a < 0.0) {
        s.current_a = 0.0;  // the diodes block
    }
    const double mean_a = 0.5 * (i0 + s.current_a);
    sums.drawn_j += h * way * s.bus_v * mean_a;
    step_bus(h, way * mean_a);
    const double sensed_before = s.sensed_a;
    sense_current(mean_a, h);
    s.time_s = t0 + h;
    sums.current_as += h * sensed_current(0.5 * (sensed_before + s.sensed_a));
    sums.bus_vs += h * sensed_supply();
    find_edges(t0, h, angle0);
}

// The filter of the current sensor, with one stage or two.
void Tool::sense_current(double mean_a, double h) {
    State &s = state;
    if (params.current_lag_s <= 0.0) {
        s.sensed_a = s.current_a;
        return;
    }
    s.sensed_first_a =
        params.current_lag2_s > 0.0
            ? mean_a + (s.sensed_first_a - mean_a) * std::exp(-h / params.current_lag2_s)
            : mean_a;
    s.sensed_a =
        s.sensed_first_a + (s.sensed_a - s.sensed_first_a) * std::exp(-h / params.current_lag_s);
}

double Tool::sensed_current(double filtered_a) const {
    const Params &p = params;
    const double bend = 1.0 + p.current_gain_bend * (std::abs(filtered_a) / p.reference_a - 1.0);
    double value = filtered_a * (1.0 + p.current_gain * bend) + p.current_offset_a;
    if (p.u_hum_a != 0.0) {
        value += p.u_hum_a * std::sin(TURN * p.u_hum_hz * state.time_s);
    }
    if (p.current_limit_a > 0.0 && p.current_limit_power > 0.0) {
        return value /
               std::pow(1.0 + std::pow(std::abs(value) / p.current_limit_a, p.current_limit_power),
                        1.0 / p.current_limit_power);
    }
    return p.current_limit_a > 0.0 ? std::clamp(value, -p.current_limit_a, p.current_limit_a)
                                   : value;
}

double Tool::sensed_supply() const {
    return state.bus_v * (1.0 + params.supply_gain);
}

double Tool::stored_energy() const {
    const State &s = state;
    double energy = 0.5 * params.inductance_h * s.current_a * s.current_a +
                    0.5 * inertia_ * s.speed_rad_s * s.speed_rad_s;
    if (two_masses_) {
        energy += 0.5 * out_inertia_ * s.out_speed_rad_s * s.out_speed_rad_s;
    }
    return energy;
}

double Tool::hall_angle(double angle) const {
    if (params.hall_eccentricity_rad == 0.0) {
        return angle;
    }
    const double phase = angle + params.hall_eccentricity_phase_rad;
    return angle + params.hall_eccentricity_rad *
                       (std::sin(phase) + params.hall_second * std::sin(2.0 * phase));
}

double Tool::edge_angle(long index) const {
    const double pitch = TURN / params.hall_edges;
    const long turn = static_cast<long>(params.hall_edges);
    const long place = ((index % turn) + turn) % turn;
    // unequal spacing: a fixed irregular pattern over a turn
    const double uneven = params.hall_spacing_rad * std::sin(2.4 * static_cast<double>(place + 1) *
                                                             static_cast<double>(place + 1));
    return params.hall_offset_rad + static_cast<double>(index) * pitch + uneven;
}

void Tool::move_to_edge(long index) {
    state.edge_index = index;
    if (params.hall_edges > 0.0) {
        edge_below_rad_ = edge_angle(index);
        edge_above_rad_ = edge_angle(index + 1);
    }
}

// Edges passed in a step, located by linear interpolation; in reverse they are late by the sensor's
// hysteresis.
void Tool::find_edges(double t0, double h, double angle0) {
    if (params.hall_edges <= 0.0 || !(std::abs(state.angle_rad - angle0) < 1.0)) {
        return;  // no sensor, or the integration has diverged
    }
    const double a0 = hall_angle(angle0), a1 = hall_angle(state.angle_rad);
    const auto keep = [&](double at, int direction) {
        const double part = a1 != a0 ? std::clamp((at - a0) / (a1 - a0), 0.0, 1.0) : 1.0;
        const double jitter =
            params.hall_jitter_s > 0.0 ? params.hall_jitter_s * random.normal() : 0.0;
        if (params.hall_dropout > 0.0) {
            state.missed =
                random.uniform() <
                (state.missed && params.hall_burst > 0.0 ? params.hall_burst : params.hall_dropout);
            if (state.missed) {
                return;
            }
        }
        edges.push_back({t0 + part * h + jitter, direction});
    };
    while (a1 >= edge_above_rad_) {
        move_to_edge(state.edge_index + 1);
        keep(edge_below_rad_, 1);
    }
    while (a1 < edge_below_rad_ - params.hall_hysteresis_rad) {
        keep(edge_below_rad_ - params.hall_hysteresis_rad, -1);
        move_to_edge(state.edge_index - 1);
    }
}

}  // namespace truth
