// Components of the impact mechanism: groove, contact and friction laws, joints and their published
// figures, counting of blows.
#include <gtest/gtest.h>

#include <cmath>

#include "plant/components/joints/disc.hpp"
#include "plant/impact/fixed_steps.hpp"
#include "plant/impact/log.hpp"
#include "plant/lockstep/impact_plant.hpp"
#include "reference_tool.hpp"

using namespace vgroove;

constexpr double PI = 3.141592653589793;

TEST(VGroove, RetractsByTheLeadAndRoundsTheVertex) {
    const VGroove g{4.4e-3, 0.05 * 0.05, 0.05, 0.0};
    EXPECT_EQ(v_groove_at(g, 0.0).x, 0.0);
    EXPECT_EQ(v_groove_at(g, 0.0).s, 0.0);
    EXPECT_NEAR(v_groove_at(g, 2.8).s, 4.4e-3, 4.4e-3 * 2e-4);
    EXPECT_DOUBLE_EQ(v_groove_at(g, -1.3).x, v_groove_at(g, 1.3).x);
    EXPECT_DOUBLE_EQ(v_groove_at(g, -1.3).s, -v_groove_at(g, 1.3).s);
}

TEST(VGroove, SlopesAreTheDerivatives) {
    const VGroove g{4.4e-3, 0.05 * 0.05, 0.05, 0.0};
    for (const double q : {-0.7, -0.05, 0.01, 0.08, 1.5}) {
        const double h = 1e-6;
        EXPECT_NEAR(v_groove_at(g, q).s,
                    (v_groove_at(g, q + h).x - v_groove_at(g, q - h).x) / (2.0 * h), 1e-11);
        EXPECT_NEAR(v_groove_at(g, q).c,
                    (v_groove_at(g, q + h).s - v_groove_at(g, q - h).s) / (2.0 * h), 1e-9);
    }
}

TEST(VGroove, EqualGroovesHaveTheLeadOfEitherAndUnequalOnesLieBetween) {
    EXPECT_NEAR(v_groove_lead(4.4e-3, 0.010, 4.4e-3, 0.010), 4.4e-3, 1e-18);
    const double lead = v_groove_lead(4.4e-3, 0.010, 5.0e-3, 0.012);
    const double spindle = 0.010 / std::cos(std::atan(0.44)),
                 hammer = 0.012 / std::cos(std::atan(5.0 / 12.0));
    const double share = hammer / (spindle + hammer);
    EXPECT_NEAR(lead, 4.4e-3 * share + 5.0e-3 * (1.0 - share), 1e-15);
}

TEST(VGroove, BallFrictionArmIsRadiusOverCosineOfTheAngle) {
    EXPECT_NEAR(v_groove_ball_arm(0.1, 4.4e-3, 0.010),
                0.1 * 0.010 / std::cos(std::atan(4.4e-3 / 0.010)), 1e-15);
}

static const Contact STEEL{3e7, 2e3, 1e-5, 1.0, 0.15, 0.10, 0.05};

TEST(Contact, DampsOnlyWhileApproachingAndRampsUp) {
    EXPECT_DOUBLE_EQ(contact_force(STEEL, 2e-5, 1.0, true, true), 3e7 * 2e-5 + 2e3);
    EXPECT_DOUBLE_EQ(contact_force(STEEL, 5e-6, 1.0, true, false), 3e7 * 5e-6 + 2e3 * 0.5);
    EXPECT_DOUBLE_EQ(contact_force(STEEL, 2e-5, -1.0, false, true), 3e7 * 2e-5);
    EXPECT_DOUBLE_EQ(contact_force(STEEL, 1e-5, 1.0, true, false),
                     contact_force(STEEL, 1e-5, 1.0, true, true));
    EXPECT_EQ(contact_force(STEEL, 0.0, 1.0, true, false), 0.0);
}

TEST(Contact, EnergyIsTheWorkOfTheSpring) {
    const Contact curved{1e9, 0.0, 1e-5, 1.5, 0.0, 0.0, 0.05};
    double work = 0.0;
    for (int n = 0; n < 10000; ++n)
        work += contact_spring(curved, (n + 0.5) * 1e-8) * 1e-8;
    EXPECT_NEAR(contact_energy(curved, 1e-4), work, 1e-6 * work);
    EXPECT_EQ(contact_energy(curved, -1e-4), 0.0);
}

TEST(Contact, FrictionRisesToStaticAndFallsToKinetic) {
    EXPECT_DOUBLE_EQ(contact_friction(STEEL, 0.025), 0.075);
    EXPECT_DOUBLE_EQ(contact_friction(STEEL, 0.05), 0.15);
    EXPECT_DOUBLE_EQ(contact_friction(STEEL, 0.0625), 0.125);
    EXPECT_DOUBLE_EQ(contact_friction(STEEL, 0.075), 0.10);
    EXPECT_DOUBLE_EQ(contact_friction(STEEL, 3.0), 0.10);
    EXPECT_DOUBLE_EQ(contact_friction(STEEL, -0.0625), -0.125);
}

TEST(DiscSpring, ReferenceSpringAtThreeQuartersOfItsTravel) {
    const DiscSpring disc{40e-3, 20.4e-3, 1.5e-3, 1.15e-3};
    EXPECT_NEAR(disc_spring_force(disc, 0.75 * 1.15e-3), 2621.0, 3.0);
    EXPECT_EQ(disc_spring_force(disc, 0.0), 0.0);
}

TEST(DiscSpring, StacksAddForceInParallelAndTravelInSeries) {
    const DiscSpring disc{40e-3, 20.4e-3, 1.5e-3, 1.15e-3};
    EXPECT_DOUBLE_EQ(disc_stack_force(disc, 4.0, 42.0, 42.0 * 0.5e-3),
                     4.0 * disc_spring_force(disc, 0.5e-3));
    EXPECT_NEAR(disc_stack_length(disc, 4.0, 42.0), 42.0 * (2.65e-3 + 3.0 * 1.5e-3), 1e-12);
}

TEST(Bolt, TighteningTorqueOfM16) {
    const Bolt bolt;
    const double friction[] = {0.10, 0.12, 0.14}, force_kn[] = {142.5, 139.2, 135.6},
                 torque_nm[] = {310.0, 354.0, 395.0};
    for (int n = 0; n < 3; ++n) {
        const double force = bolt_preload(bolt, friction[n]);
        EXPECT_NEAR(force, force_kn[n] * 1e3, 60.0);
        EXPECT_NEAR(bolt_torque(bolt, force, friction[n], friction[n]), torque_nm[n], 0.6);
    }
}

static SlipTorques slip_at(const Joint &j, double head_rad) {
    return joint_slip(j, joint_segment_at(j, head_rad), head_rad, 0.0);
}

TEST(Joint, HardJointSlipsAtRunTorqueThenAtTheSlope) {
    Parameters p;
    p.load.run_torque_nm = 0.3;
    p.load.slip_slope_nm_per_rad = 700.0;
    const Joint j = joint_from(p, LoadKind::HARD_JOINT);
    EXPECT_DOUBLE_EQ(slip_at(j, -0.1).forward_nm, 0.3);
    EXPECT_DOUBLE_EQ(slip_at(j, 0.0).forward_nm, 0.3);
    EXPECT_DOUBLE_EQ(slip_at(j, 0.2).forward_nm, 140.3);
    EXPECT_DOUBLE_EQ(slip_at(j, 0.2).backward_nm, 0.3 + 0.75 * 140.0);
    p.effects.thread_friction.relative = 0.1;
    EXPECT_NEAR(slip_at(joint_from(p, LoadKind::HARD_JOINT), 0.2).forward_nm, 1.1 * 140.3, 1e-12);
    EXPECT_EQ(slip_at(joint_from(p, LoadKind::LOCKED), 0.2).forward_nm,
              std::numeric_limits<double>::infinity());
    EXPECT_EQ(slip_at(joint_from(p, LoadKind::NONE), 0.2).forward_nm, 0.0);
}

static Parameters m6_screw() {
    Parameters p;
    p.load.stiffness_nm_per_rad = 100.0;
    p.load.start_nm = 0.5;
    p.load.end_nm = 6.0;
    p.load.turns = 36.0;
    p.load.seat_nm = 12.0;
    p.load.from_turns = 12.0;
    p.load.loosen_ratio = 0.6;
    return p;
}

TEST(Joint, WoodScrewRunsInSeatsAndStrips) {
    const Joint j = joint_from(m6_screw(), LoadKind::WOOD_SCREW);
    const double seat = 24.0 * 2.0 * PI, strip = seat + 0.5 * PI, stripped = strip + 0.65 * PI;
    EXPECT_NEAR(slip_at(j, -12.0 * 2.0 * PI + 1e-9).forward_nm, 0.5, 1e-9);
    EXPECT_NEAR(slip_at(j, 0.0).forward_nm, 0.5 + 5.5 * 12.0 / 36.0, 1e-12);
    EXPECT_NEAR(slip_at(j, seat - 1e-9).forward_nm, 6.0, 1e-6);
    EXPECT_NEAR(slip_at(j, seat + 0.25 * PI).forward_nm, 9.0, 1e-9);
    EXPECT_NEAR(slip_at(j, strip).forward_nm, 12.0, 1e-9);
    EXPECT_NEAR(slip_at(j, strip + 0.5 * PI).forward_nm, 6.0, 1e-9);
    EXPECT_NEAR(slip_at(j, stripped + 1.0).forward_nm, 0.35 * 12.0, 1e-9);
    EXPECT_NEAR(slip_at(j, 0.0).backward_nm, 0.6 * slip_at(j, 0.0).forward_nm, 1e-12);
}

TEST(Joint, AKnotAddsItsTorqueBetweenTwoHeadAngles) {
    Parameters p = m6_screw();
    const Joint clear = joint_from(p, LoadKind::WOOD_SCREW);
    p.effects.wood_knot.torque_nm = 3.0;
    p.effects.wood_knot.from_rad = 10.0;
    p.effects.wood_knot.to_rad = 12.0;
    const Joint knotted = joint_from(p, LoadKind::WOOD_SCREW);
    EXPECT_DOUBLE_EQ(slip_at(knotted, 9.999).forward_nm, slip_at(clear, 9.999).forward_nm);
    EXPECT_NEAR(slip_at(knotted, 10.0).forward_nm, slip_at(clear, 10.0).forward_nm + 3.0, 1e-12);
    EXPECT_NEAR(slip_at(knotted, 11.999).forward_nm, slip_at(clear, 11.999).forward_nm + 3.0,
                1e-12);
    EXPECT_NEAR(slip_at(knotted, 12.0).forward_nm, slip_at(clear, 12.0).forward_nm, 1e-12);
}

TEST(Joint, DiscStackThroughTheBolt) {
    Parameters p;
    p.load.parallel = 4.0;
    p.load.series = 42.0;
    p.load.from_turns = 4.0;
    p.load.run_torque_nm = 0.3;
    const Joint j = joint_from(p, LoadKind::DISC_SPRING);
    const DiscSpring disc{40e-3, 20.4e-3, 1.5e-3, 1.15e-3};
    for (const double turns : {0.0, 3.0, 12.0}) {
        const double force = disc_stack_force(disc, 4.0, 42.0, 2e-3 * (4.0 + turns)),
                     head = 2.0 * PI * turns;
        const double friction = (0.58 * 14.701e-3 + 0.01) * 0.12;
        EXPECT_NEAR(slip_at(j, head).forward_nm, 0.3 + bolt_torque(Bolt{}, force, 0.12, 0.12),
                    1e-9);
        EXPECT_NEAR(slip_at(j, head).backward_nm, 0.3 + force * (friction - 0.16 * 2e-3), 1e-9);
    }
    const double flat = 2.0 * PI * (42.0 * 1.15 / 2.0 - 4.0);
    EXPECT_NEAR(slip_at(j, flat + 0.1).forward_nm, slip_at(j, flat).forward_nm + 70.0, 1e-6);
    p.effects.joint_hysteresis.relative = 0.2;
    const Joint lossy = joint_from(p, LoadKind::DISC_SPRING);
    EXPECT_DOUBLE_EQ(slip_at(lossy, 1.0).forward_nm, slip_at(j, 1.0).forward_nm);
    EXPECT_NEAR(slip_at(lossy, 1.0).backward_nm - 0.3, 0.8 * (slip_at(j, 1.0).backward_nm - 0.3),
                1e-9);
}

TEST(Blows, NewLugIsABlowLaterContactsAreRepeatsOrRebounds) {
    BlowRecorder r;
    blows_begin(r, 0.0, 0, 100.0, 4e-3, 0.0);
    blows_end(r, 0.5);
    blows_begin(r, 0.0005, 0, 90.0, 4e-3, 0.5);  // soon: a rebound, however fast
    blows_begin(r, 0.0031, 0, 24.9, 4e-3, 0.6);  // late but slow
    blows_begin(r, 0.0031, 0, 25.0, 4e-3, 0.6);  // late and fast enough
    blows_begin(r, 0.0050, 3, 80.0, 2e-3, 0.7);  // two lugs missed
    const long kinds[] = {BLOW_FIRST, BLOW_REBOUND, BLOW_REBOUND, BLOW_REPEAT, BLOW_FIRST};
    for (std::size_t n = 0; n < 5; ++n)
        EXPECT_EQ(r.blows[n].kind, kinds[n]) << n;
    EXPECT_DOUBLE_EQ(r.blows[0].impulse_nm_s, 0.5);
    EXPECT_EQ(r.blows[4].skipped, 2);
}

TEST(Impact, ParametersOutOfRangeAreNamed) {
    Parameters p = reference_tool();
    p.lug_overlap_rad = 3.2;
    EXPECT_THROW(impact_from(p, LoadKind::LOCKED, InputKind::DUTY, false, 1.0),
                 std::invalid_argument);
    p = reference_tool();
    p.travel_rad = 1.0;  // 4.2 mm: below the lugs
    EXPECT_THROW(impact_from(p, LoadKind::LOCKED, InputKind::DUTY, false, 1.0),
                 std::invalid_argument);
    p = reference_tool();
    p.hammer_start_rad = 0.5;  // on a lug
    EXPECT_THROW(impact_from(p, LoadKind::LOCKED, InputKind::DUTY, false, 1.0),
                 std::invalid_argument);
    p.hammer_start_rad = -2.2;
    EXPECT_THROW(impact_from(p, LoadKind::LOCKED, InputKind::DUTY, false, 1.0),
                 std::invalid_argument);
    p.hammer_start_rad = -2.1;
    EXPECT_NO_THROW(impact_from(p, LoadKind::LOCKED, InputKind::DUTY, false, 1.0));
}

// Largest number of derivatives that a fixed step of step_s may need: in each piece three steps of
// six derivatives, with at most eight more each for their events.
static double most_work(double step_s) {
    return std::ceil(step_s / IMPACT_PIECE_S) * (IMPACT_EVENTS_LOCATED_MAX + 1) * (6.0 + 8.0);
}

TEST(ImpactPlant, FixedStepsHaveBoundedWork) {
    Parameters p = reference_tool();
    p.load.run_torque_nm = 6.0;  // the joint with the most contacts
    for (const double step_s : {10e-6, 35e-6, 70e-6}) {
        ImpactPlant tool(p, LoadKind::HARD_JOINT, HallWheel{}, 1, ImpactAccuracy::FIXED, step_s);
        double before = 0.0, worst = 0.0;
        for (int n = 0; n < static_cast<int>(0.4 / step_s); ++n) {
            tool.advance(step_s, 1.0, false, 0.0);
            const double now = tool.statistics().derivatives;
            worst = std::max(worst, now - before);
            before = now;
        }
        EXPECT_LE(worst, most_work(step_s));
        EXPECT_GT(worst, 6.0);
    }
}

// Hammer and anvil at an angle of 20 rad separate slowly. Within 1e-12 s, to which events are
// located, rounding changes both angles by the same amount: the penetration stays exactly 0 unless
// the step is longer.
TEST(ImpactSolver, ReferenceModeLeavesAContactWhosePenetrationIsExactlyZero) {
    using L = AuditLayout;
    const Parameters p = reference_tool();
    for (int n = 0; n < 30; ++n) {
        ImpactSolver<L> s{};
        s.parameters = &p;
        s.model = impact_from(p, LoadKind::NONE, InputKind::DUTY, false, 0.0);
        s.tolerance = IMPACT_TOLERANCE_REFERENCE;
        impact_start(s);
        impact_enter_contact(s.mode, ContactPlace::FORWARD);
        s.mode.approaching = false;
        s.mode.drive.slide = 1.0;
        s.mode.slip = 1;
        const double speed = 200.0 + 0.37 * n;
        s.state.x[L::HAMMER_ANGLE] = 20.0;
        s.state.x[L::ANVIL_ANGLE] = 20.0 + s.model.start_rad - s.mode.forward_rad;
        s.state.x[STATE_ANGLE] = s.model.ratio * 20.0;
        s.state.x[L::HAMMER_SPEED] = speed;
        s.state.x[L::ANVIL_SPEED] = speed + 0.003;
        s.state.x[STATE_SPEED] = s.model.ratio * speed;
        impact_run(s, 1e-7);
        EXPECT_EQ(s.mode.place, ContactPlace::NONE) << speed;
        EXPECT_LT(s.stats.steps, 20.0) << speed;
    }
}

// Contacts of a run of 0.2 s in steps of one PWM period; the bridge is open from open_s on.
static std::vector<Blow> contacts_of(const Parameters &p, ImpactAccuracy accuracy, double duty,
                                     double dead, double open_s) {
    ImpactPlant tool(p, LoadKind::HARD_JOINT, HallWheel{}, 1, accuracy, 0.0);
    std::vector<Blow> found;
    for (int n = 0; n * PERIOD_S < 0.2; ++n) {
        tool.period(n * PERIOD_S > open_s, duty, dead, 0.0);
        for (const Blow &b : tool.take_blows())
            found.push_back(b);
    }
    return found;
}

// The contacts of fast mode are those of reference mode.
static void expect_same_contacts(const Parameters &p, double duty, double dead, double open_s) {
    const std::vector<Blow> fast = contacts_of(p, ImpactAccuracy::FAST, duty, dead, open_s);
    const std::vector<Blow> reference =
        contacts_of(p, ImpactAccuracy::REFERENCE, duty, dead, open_s);
    ASSERT_EQ(fast.size(), reference.size());
    ASSERT_GE(fast.size(), 5u);
    for (std::size_t n = 0; n < fast.size(); ++n) {
        EXPECT_EQ(fast[n].lug, reference[n].lug);
        EXPECT_NEAR(fast[n].time_s, reference[n].time_s, 20e-6);
        EXPECT_NEAR(fast[n].impulse_nm_s, reference[n].impulse_nm_s,
                    2e-3 * std::fabs(reference.back().impulse_nm_s));
        EXPECT_NEAR(fast[n].peak_torque_nm, reference[n].peak_torque_nm,
                    2e-3 * reference.back().peak_torque_nm);
    }
}

// On either flank, with dead time and with an open bridge, the Taylor series of fast mode give the
// contacts of reference mode.
TEST(ImpactPlant, FastModeHasTheContactsOfReferenceMode) {
    Parameters p = reference_tool();
    for (const double run_nm : {6.0, 60.0, 400.0}) {
        p.load.run_torque_nm = run_nm;
        for (const double duty : {1.0, -1.0, 0.8}) {
            SCOPED_TRACE(testing::Message() << run_nm << " N m, duty " << duty);
            expect_same_contacts(p, duty, duty == 0.8 ? 0.05 : 0.0, 0.16);
        }
    }
}

// Effects at supply, motor and sensors enter the Taylor series by their rates. The tool is driven
// all the time.
TEST(ImpactPlant, FastModeHasTheContactsOfReferenceModeWithEffectsAtTheMotor) {
    const auto expect_with = [](const char *effect, auto change) {
        SCOPED_TRACE(effect);
        Parameters p = reference_tool();
        p.load.run_torque_nm = 60.0;
        change(p.effects);
        expect_same_contacts(p, 1.0, 0.0, 1.0);
    };
    using Effects = EffectParameters;
    expect_with("coulomb friction", [](Effects &e) { e.coulomb_friction.torque_nm = 0.01; });
    expect_with("load friction", [](Effects &e) { e.load_dependent_friction.relative = 0.1; });
    expect_with("brush drop", [](Effects &e) { e.brush_drop.voltage_v = 0.5; });
    expect_with("droop", [](Effects &e) {
        e.supply_droop.volt_per_coulomb = 0.01;
        e.supply_droop.polarisation_ohm = 0.05;
        e.supply_droop.polarisation_s = 0.1;
    });
    expect_with("heating", [](Effects &e) { e.winding_heating.kelvin_per_joule = 0.05; });
    expect_with("current lag", [](Effects &e) { e.current_lag.time_constant_s = 2e-3; });
    expect_with("speed lag", [](Effects &e) { e.speed_lag.time_constant_s = 2e-3; });
}

// Fast mode is fast because a blow with all its contacts and slips takes few steps.
TEST(ImpactPlant, FastModeTakesFewStepsABlow) {
    for (const double run_nm : {60.0, 400.0}) {
        Parameters p = reference_tool();
        p.load.run_torque_nm = run_nm;
        ImpactPlant tool(p, LoadKind::HARD_JOINT, HallWheel{}, 1, ImpactAccuracy::FAST, 0.0);
        tool.advance(0.5, 1.0, false, 0.0);
        const ImpactStats s = tool.statistics();
        EXPECT_LT(s.steps, 36.0 * static_cast<double>(tool.take_blows().size()));
        EXPECT_LT(s.rejected, 0.12 * s.steps);
    }
}

TEST(ImpactPlant, RestsUntilItIsDriven) {
    ImpactPlant tool(reference_tool(), LoadKind::LOCKED, hall_wheel(4, 0.3, {}), 1,
                     ImpactAccuracy::FAST, 0.0);
    for (int n = 0; n < 1000; ++n)
        EXPECT_EQ(tool.period(false, 0.0, 0.0, 0.0).edge_count, 0);
    EXPECT_EQ(tool.now().speed_rad_s, 0.0);
    EXPECT_EQ(tool.now().angle_rad, 0.0);
}

TEST(ImpactPlant, EachBlowIsReturnedOnce) {
    ImpactPlant tool(reference_tool(), LoadKind::LOCKED, HallWheel{}, 1, ImpactAccuracy::FAST, 0.0);
    ImpactPlant whole(reference_tool(), LoadKind::LOCKED, HallWheel{}, 1, ImpactAccuracy::FAST,
                      0.0);
    std::vector<Blow> pieces;
    for (int n = 0; n < 300; ++n) {
        tool.advance(1e-3, 1.0, false, 0.0);
        whole.advance(1e-3, 1.0, false, 0.0);
        for (const Blow &b : tool.take_blows())
            pieces.push_back(b);
    }
    const std::vector<Blow> all = whole.take_blows();
    ASSERT_EQ(pieces.size(), all.size());
    ASSERT_GT(all.size(), 5u);
    for (std::size_t n = 0; n < all.size(); ++n) {
        EXPECT_EQ(pieces[n].time_s, all[n].time_s);
        EXPECT_EQ(pieces[n].kind, all[n].kind);
    }
    EXPECT_TRUE(whole.take_blows().empty());
}
