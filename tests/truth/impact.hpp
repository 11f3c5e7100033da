// The impact mechanism of a generated tool: motor, gear, spindle, ball in its groove, hammer, lugs
// with penalty contacts, anvil and joint, docs/spec/model.md, sections 4 to 6, integrated with an
// adaptive step.
#pragma once

#include <array>
#include <deque>
#include <vector>

#include "tool.hpp"

namespace truth {

// Parameters, SI units; Python sets them by these names. Those of an effect are neutral by default.
struct ImpactParams {
    // supply and bridge
    double voltage_v = 18.5, supply_resistance_ohm = 0.10, pwm_hz = 20000.0;
    double droop_volt_per_coulomb = 0.0, polarisation_ohm = 0.0, polarisation_s = 1.0;
    double polarisation2_ohm = 0.0, polarisation2_s = 1.0;
    double dead_time_s = 0.0, bridge_resistance_ohm = 0.0, transport_delay_s = 0.0;
    // motor
    double resistance_ohm = 0.19, inductance_h = 1e-4, torque_constant_nm_per_a = 0.0109;
    double brush_drop_v = 0.0, brush_knee_a = 0.25, saturation_a = 0.0;
    double heating_kelvin_per_joule = 0.0, heating_cooling_s = 20.0, heating_housing_share = 0.15;
    double inertia_kg_m2 = 1.6e-5, viscous_nm_s_per_rad = 4.5e-6, coulomb_nm = 0.012;
    double breakaway_nm = 0.0, stribeck_rad_s = 60.0, quadratic_nm_s2 = 0.0;
    double directional_viscous_nm_s = 0.0;
    double cogging_nm = 0.0, cogging_per_rev = 12.0, cogging_phase_rad = 0.0, cogging_second = 0.15;
    double grease_nm_s = 0.0, grease_s = 2.0;
    // gear
    double ratio = 5.6, output_inertia_kg_m2 = 6e-6;
    double load_friction = 0.0, load_friction_power = 1.0, load_reference_nm = 0.3;
    double eccentricity_nm = 0.0, eccentricity_phase_rad = 0.0;
    // mechanism
    double hammer_inertia_kg_m2 = 4.5e-5, hammer_mass_kg = 0.19;
    double groove_lead_m_per_rad = 4.4e-3, groove_radius_m = 0.010, vertex_rad = 0.05,
           travel_rad = 2.8;
    double spring_preload_n = 220.0, spring_rate_n_per_m = 29400.0;
    double lug_count = 2.0, lug_height_m = 4.5e-3, lug_radius_m = 0.015, lug_overlap_rad = 1.0;
    double contact_stiffness_n_per_m = 3e7, contact_damping_n_s_per_m = 2e3, contact_ramp_m = 1e-5;
    double anvil_inertia_kg_m2 = 1.2e-5, groove_friction = 0.0, groove_knee_rad_s = 0.5;
    // joint: elastic twist; its slip torques are the table of the run
    double joint_nm_per_rad = 3000.0, joint_nm_s_per_rad = 0.3;
    double coupler_nm_per_rad = 0.0, coupler_nm_s_per_rad = 0.2, coupler_inertia_kg_m2 = 0.0;
    // sensors
    double current_lag_s = 0.0, current_gain = 0.0, current_offset_a = 0.0, current_limit_a = 0.0;
    double supply_gain = 0.0, hall_edges = 4.0, hall_offset_rad = 0.3, hall_jitter_s = 0.0;
    double hall_eccentricity_rad = 0.0, hall_eccentricity_phase_rad = 0.0, hall_dropout = 0.0;
    double current_noise_a = 0.0, supply_noise_v = 0.0;
    // outside the catalogue; the gate switches intermittent effects on and off at random times
    double gate_on_s = 0.2, gate_off_s = 0.5, u_brush_ohm = 0.0, u_contact_ohm = 0.0,
           u_flux_loss = 0.0, u_load_nm = 0.0;
    double u_groove_dent_m = 0.0, u_dent_at_rad = 0.8, u_dent_width_rad = 0.15;
    double u_lug_offset_rad = 0.0, u_lug_height_m = 0.0;
    double u_coil_bind_n_per_m = 0.0, u_coil_bind_at_m = 7e-3;
    double u_housing_drag_nm = 0.0, u_drag_from_m = 2e-3, u_drag_width_m = 1e-3;
    double u_arm_inertia_kg_m2 = 0.0, u_arm_nm_per_rad = 25.0, u_arm_nm_s_per_rad = 0.25;
    double u_bit_play_rad = 0.0;
    double u_heat_per_joule = 0.0, u_heat_s = 0.5;
    double u_wander_nm = 0.0, u_wander_s = 1.3;
    // functional forms other than the catalogue's: powers over a reference, second stages, bends
    double extra_ohm = 0.0, extra_ohm_power = 0.0, extra_source_ohm = 0.0, source_power = 0.0,
           reference_a = 25.0;
    double power_coulomb_nm = 0.0, coulomb_power = 0.0, extra_viscous_nm_s = 0.0,
           viscous_power = 1.0, reference_rad_s = 900.0;
    double groove_static = 0.0, spring_square_n_per_m2 = 0.0, extra_damping_n_s_per_m2 = 0.0,
           joint_cubic_per_rad2 = 0.0;
    double current_lag2_s = 0.0, current_gain_bend = 0.0;
    // start, tolerance of a step relative to its default, largest step, seed of the random numbers
    double hammer_start_rad = -1.0, tolerance = 1.0, step_s = 1.5e-4, seed = 1.0;
};

// Address of a parameter by its name, or nullptr.
double *find_impact_param(ImpactParams &params, const char *name);

// Slip torques of the joint at equal steps of the head angle, linear between them, constant beyond.
struct SlipTable {
    const double *forward_nm = nullptr, *backward_nm = nullptr;
    int count = 0;
    double first_rad = 0.0, step_rad = 1.0;
};

// A touch of a lug by the hammer after at least a free passage; peak_nm is the largest joint torque
// until the next one.
struct Blow {
    double time_s, lug, approach_rad_s, peak_nm, head_rad, motor_rad;
};

enum StateIndex {
    CURRENT,
    SPINDLE_SPEED,
    SPINDLE,
    HAMMER_SPEED,
    HAMMER,
    ANVIL_SPEED,
    ANVIL,
    TWIST,
    BRISTLE,
    BIT_SPEED,
    BIT,
    ARM_SPEED,
    ARM,
    SENSED,
    SENSED_FIRST,
    CONTROLLED_COUNT,  // the states above control the step
    CHARGE = CONTROLLED_COUNT,
    SENSED_CHARGE,
    BUS,
    INPUT_J,
    LOST_J,
    STATE_COUNT
};
using StateVector = std::array<double, STATE_COUNT>;

// Where the hammer's lugs are: between the anvil's lugs, retracted beyond them, or on top of one.
enum class LugPlace { GAP, CLEAR, OVER };

// States that change little in a step: heat, charge, events.
struct SlowStates {
    double charge_c = 0.0, polarisation_v = 0.0, polarisation2_v = 0.0;
    double winding_kelvin = 0.0, housing_kelvin = 0.0, joint_heat = 0.0;
    bool gate = false;
    double gate_until_s = 0.0;
};

class ImpactTool {
public:
    ImpactParams params;
    SlipTable slip;
    StateVector state{};
    SlowStates slow;
    double time_s = 0.0;
    std::vector<Edge> edges;
    std::vector<Blow> blows;
    RandomStream random{1};
    long steps = 0;
    double dead_share = 0.0;     // of the bus voltage, that the dead time of the lock-step takes
    std::deque<Drive> commands;  // of the lock-step, those that have not reached the bridge

    void start();
    // Integrates to end_s with the duty linear in time.
    void advance(double end_s, double duty_begin, double duty_end, bool coast);
    double motor_speed() const;
    double motor_angle() const;
    double sensed_current() const;
    double joint_torque() const { return joint_nm_; }
    double travel_m() const;
    double stored_energy() const;

private:
    struct Groove {
        double travel, slope, bend;  // x, dx/dq, d2x/dq2
    };
    struct Contact {
        double stored_n, damping_n;
    };
    struct Push {
        double hammer_nm, loss_w;
    };

    LugPlace place_ = LugPlace::GAP;
    long lug_ = 0, last_lug_ = -1000000;
    bool touching_ = false;
    bool coast_ = false;
    double duty_begin_ = 0.0, duty_rate_ = 0.0, duty_from_s_ = 0.0;
    double bristle_nm_per_rad_ = 12.0, bristle_nm_s_ = 0.02;
    double resistance_ = 0.0, k_ = 0.0, open_circuit_v_ = 0.0, source_ohm_ = 0.0, wander_nm_ = 0.0;
    double step_s_ = 1e-6, joint_nm_ = 0.0, slip_rate_ = 0.0, peak_nm_ = 0.0;
    long edge_index_ = 0;
    bool missed_ = false;
    StateVector first_{};
    bool first_known_ = false;

    StateVector rates(double t, const StateVector &y);
    void electric_rates(double t, const StateVector &y, StateVector &d) const;
    double bridge_voltage(double duty, double bus, double current) const;
    double saturated_k(double current) const;
    double friction(double t, const StateVector &y, StateVector &d) const;
    double dry_level(double w, double current) const;
    void joint_rates(const StateVector &y, StateVector &d);
    double slip_torque(double head, const double *table) const;
    Push lug_push(const StateVector &y) const;
    Contact contact(double depth, double rate) const;
    Contact axial(const Groove &groove, double rate) const;
    Groove groove(double q) const;
    void hammer_rates(const StateVector &y, double shaft_nm, const Push &push, StateVector &d);
    double flank(long lug) const;
    double height(long lug) const;
    double gap_width() const;
    bool try_step(double h, StateVector &next, StateVector &last, double &error);
    bool place_changes(const StateVector &y) const;
    void move_place(const StateVector &y);
    void note_touch(const StateVector &y);
    void after_step(double h, const StateVector &before);
    void slow_rates(double h);
    void find_edges(double h, double from, double to);
    double hall_angle(double angle) const;
    double edge_angle(long index) const;
    double contact_energy() const;
    double sensed(double current) const;
    double sensor_rates(double current, const StateVector &y, StateVector &d) const;
    double spring_force(double travel) const;
    double hammer_drag(const StateVector &y, double travel) const;
    double groove_rub(double force, double q_rate) const;
};

}  // namespace truth
