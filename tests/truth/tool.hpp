// The drive of a power tool with the details of a real one: switched bridge, bristle friction, Hall
// edges located within the step.
#pragma once

#include <cstdint>
#include <deque>
#include <vector>

#include "params.hpp"

namespace truth {

// Random numbers by splitmix64 (Steele 2014), the same on every machine.
class RandomStream {
public:
    explicit RandomStream(std::uint64_t seed) : state_(seed) {}
    double uniform();
    double normal();

private:
    std::uint64_t state_;
};

struct Edge {
    double time_s;
    int direction;
};

// A bristle of the LuGre model: deflection z, torque stiffness * z.
struct Bristle {
    double deflection_rad = 0.0;
    double torque_nm = 0.0;
};

struct State {
    double time_s = 0.0;
    double current_a = 0.0;
    double bus_v = 0.0;
    double speed_rad_s = 0.0, angle_rad = 0.0;
    // of the output side, referred to the motor shaft; those of the motor where the drive is rigid
    double out_speed_rad_s = 0.0, out_angle_rad = 0.0;
    Bristle motor_bristle, load_bristle;
    double charge_c = 0.0, polarisation_v = 0.0;
    double winding_kelvin = 0.0, housing_kelvin = 0.0;
    double sensed_a = 0.0, sensed_first_a = 0.0;
    double polarisation2_v = 0.0;
    bool missed = false;
    double ripple_rad = 0.0, ripple_rate = 0.0;
    bool gate = false;
    double gate_until_s = 0.0;
    long edge_index = 0;
};

// Integrals over the current row, and energies since the start for the energy balance.
struct Sums {
    double current_as = 0.0, bus_vs = 0.0;
    double drawn_j = 0.0, copper_j = 0.0, friction_j = 0.0, load_j = 0.0;
};

struct Drive {
    bool coast = false;
    double duty = 0.0;
    double dead_s = 0.0;  // largest shift of each edge of the switching leg, against the current
    double load_nm = 0.0;
    double bus_v = 0.0;  // above 0: the bus voltage, in place of the source
    double extra_supply_v = 0.0, extra_coulomb_nm = 0.0;  // disturbances: added to those of params
};

// A torque against the motor that depends on its angle: values at equal steps of the angle, linear
// between them, periodic.
struct AngleTorque {
    const double *torque_nm = nullptr;
    int count = 0;
    double step_rad = 1.0;
    double at(double angle_rad) const;
};

class Tool {
public:
    Params params;
    State state;
    Sums sums;
    std::vector<Edge> edges;
    RandomStream random{1};
    std::deque<Drive> commands;  // of the lock-step, those that have not reached the bridge
    AngleTorque roughness;       // of the bearings

    void start();
    // Begins a PWM period of the given length at state.time_s.
    void begin_period(double period_s, const Drive &drive);
    // Advances to the end of the period, or to cut_s where that lies within it; returns whether
    // cut_s is reached.
    bool advance(double cut_s);
    double sensed_current(double filtered_a) const;
    double sensed_supply() const;
    double stored_energy() const;

private:
    struct Span {
        double end_s;
        int leg_a;  // 1 high, 0 low, -1 floating: its diodes conduct
        int leg_b;
    };
    Span spans_[6];
    int span_count_ = 0, span_ = 0;
    Drive drive_;
    double load_at_shaft_nm_ = 0.0, k_ = 0.0, resistance_ = 0.0, open_circuit_v_ = 0.0,
           source_ohm_ = 0.0;
    double inertia_ = 0.0, out_inertia_ = 0.0, stiffness_ = 0.0, load_stiffness_ = 0.0,
           step_s_ = 5e-6, coupling_nm_ = 0.0;
    double damping_ = 0.0, load_damping_ = 0.0;  // of the bristles, constant over a period
    // angles of the nearest Hall edge below and of the nearest one above the angle of the shaft
    double edge_below_rad_ = 0.0, edge_above_rad_ = 0.0;
    bool two_masses_ = false;

    void slow_states(double period_s);
    void move_gate();
    void plan_spans(double period_s);
    void step(double h, int leg_a, int leg_b);
    int bridge_sign(int leg_a, int leg_b) const;
    double saturated_k(double current_a) const;
    double inductance(double current_a) const;
    double extra_resistance() const;
    void sense_current(double mean_a, double h);
    double dry_level(double speed) const;
    double smooth_torque() const;
    void step_shaft(double h, double volts, bool conducting);
    void step_output(double h);
    double coupling_rate() const;
    double coupling_torque(double h) const;
    void step_bus(double h, double bus_a);
    void find_edges(double t0, double h, double angle0);
    double edge_angle(long index) const;
    // Sets state.edge_index and the angles of this edge and of the one above it.
    void move_to_edge(long index);
    double hall_angle(double angle) const;
};

}  // namespace truth
