// Laws of the drill driver (docs/spec/model.md, section 7): energy, clutch, rest, slopes, and its
// solvers against one another.
#include <algorithm>
#include <cmath>
#include <gtest/gtest.h>
#include <stdexcept>
#include <string>

#include "plant/drill/real_time.hpp"

using namespace vgroove;

static DrillRun run_of(const DrillParameters &p, DrillSolver solver, double step_s, double row_s) {
    DrillRequest r;
    r.solver = solver;
    r.step_s = step_s;
    r.row_s = row_s;
    return drill_run(p, r);
}

static double at(const DrillRun &run, std::size_t row, int column) {
    return run.rows[row * DRILL_ROW_COUNT + static_cast<std::size_t>(column)];
}

static std::size_t rows_of(const DrillRun &run) {
    return run.rows.size() / DRILL_ROW_COUNT;
}

// Source energy less losses, work and stored energy, J
static double unbalanced(const DrillRun &run, std::size_t row) {
    double energy = at(run, row, DRILL_ROW_SUMS + DRILL_WORK_IN) - at(run, row, DRILL_ROW_STORED);
    for (const DrillSum loss : {DRILL_LOSS_WINDING, DRILL_LOSS_MOTOR, DRILL_LOSS_SHAFT,
                                DRILL_LOSS_CLUTCH, DRILL_WORK_LOAD})
        energy -= at(run, row, DRILL_ROW_SUMS + loss);
    return energy;
}

// Low gear with several torques of the clutch: one that always grips, others that slip under the
// load.
class DrillOfClutch : public ::testing::TestWithParam<double> {
protected:
    DrillParameters parameters(bool pulse) const {
        DrillParameters p;
        p.clutch_nm = GetParam();
        p.pulse = pulse ? 1.0 : 0.0;
        return p;
    }
};

TEST_P(DrillOfClutch, EnergyBalances) {
    for (const bool pulse : {false, true}) {
        const DrillRun run = run_of(parameters(pulse), DrillSolver::REFERENCE, 0.0, 1e-3);
        ASSERT_EQ(rows_of(run), 4001u);
        for (std::size_t n = 0; n < rows_of(run); ++n)
            ASSERT_NEAR(unbalanced(run, n), 0.0,
                        1e-6 * at(run, rows_of(run) - 1, DRILL_ROW_SUMS + DRILL_WORK_IN))
                << at(run, n, DRILL_ROW_TIME);
        for (const DrillSum loss : {DRILL_LOSS_WINDING, DRILL_LOSS_MOTOR, DRILL_LOSS_SHAFT,
                                    DRILL_LOSS_CLUTCH, DRILL_WORK_LOAD})
            for (std::size_t n = 1; n < rows_of(run); ++n)
                ASSERT_GE(at(run, n, DRILL_ROW_SUMS + loss),
                          at(run, n - 1, DRILL_ROW_SUMS + loss) - 1e-9)
                    << loss;
    }
}

TEST_P(DrillOfClutch, ShaftNeverCarriesMoreThanTheClutch) {
    double most = 0.0;
    for (const DrillSolver solver : {DrillSolver::REFERENCE, DrillSolver::REAL_TIME}) {
        const DrillRun run = run_of(parameters(true), solver, 35e-6, 35e-6);
        for (std::size_t n = 0; n < rows_of(run); ++n)
            most = std::max(most, std::fabs(at(run, n, DRILL_ROW_SHAFT)));
    }
    EXPECT_LE(most, GetParam() * (1.0 + 1e-9));
    EXPECT_GT(most, std::min(GetParam(), 6.0) * 0.99);
}

TEST_P(DrillOfClutch, RealTimeAgreesWithTheReferenceAtEveryStepLength) {
    for (const double step_s : {40e-6, 1e-3, 0.1}) {
        const DrillRun run = run_of(parameters(true), DrillSolver::REAL_TIME, step_s, step_s);
        const DrillRun reference = run_of(parameters(true), DrillSolver::REFERENCE, 0.0, step_s);
        ASSERT_EQ(rows_of(run), rows_of(reference));
        const double free = parameters(true).supply_v / parameters(true).constant;
        for (std::size_t n = 0; n < rows_of(run); ++n)
            ASSERT_NEAR(at(run, n, DRILL_ROW_CORE + DRILL_SPEED),
                        at(reference, n, DRILL_ROW_CORE + DRILL_SPEED), 1e-5 * free)
                << at(run, n, DRILL_ROW_TIME);
    }
}

INSTANTIATE_TEST_SUITE_P(DrillDriver, DrillOfClutch, ::testing::Values(4.0, 5.9, 30.0));

TEST(DrillDriver, SlippingClutchHoldsTheChuckOfAStrongerLoad) {
    DrillParameters p;
    p.clutch_nm = 4.0;
    const DrillRun run = run_of(p, DrillSolver::REFERENCE, 0.0, 1e-3);
    EXPECT_NEAR(at(run, 2500, DRILL_ROW_CORE + DRILL_CHUCK), 0.01 * std::atanh(4.0 / 6.0),
                0.02);  // the law's steep middle
    EXPECT_DOUBLE_EQ(at(run, 2500, DRILL_ROW_SHAFT), 4.0);
    EXPECT_GT(at(run, 2500, DRILL_ROW_CORE + DRILL_SPEED), 1300.0);
}

// The motor turns from k i = Tc = 12 mN m on, which is 1.1 A, 0.21 V or a duty of 0.0116
TEST(DrillDriver, MotorRestsBelowItsCoulombTorque) {
    DrillParameters p;
    for (const DrillSolver solver :
         {DrillSolver::REFERENCE, DrillSolver::REAL_TIME, DrillSolver::EULER, DrillSolver::RK4}) {
        p.duty = 0.0115;
        EXPECT_EQ(at(run_of(p, solver, 5e-6, 1.0), 4, DRILL_ROW_CORE + DRILL_SPEED), 0.0);
        p.duty = 0.0118;
        EXPECT_GT(at(run_of(p, solver, 5e-6, 1.0), 4, DRILL_ROW_CORE + DRILL_SPEED), 0.0);
    }
}

TEST(DrillDriver, ReverseIsTheMirrorImage) {
    DrillParameters p;
    p.pulse = 1.0;
    const DrillRun forward = run_of(p, DrillSolver::REFERENCE, 0.0, 1e-2);
    p.duty = -1.0;
    const DrillRun backward = run_of(p, DrillSolver::REFERENCE, 0.0, 1e-2);
    for (std::size_t n = 0; n < rows_of(forward); ++n)
        for (const DrillCore state : {DRILL_CURRENT, DRILL_SPEED, DRILL_CHUCK})
            ASSERT_NEAR(at(forward, n, DRILL_ROW_CORE + state),
                        -at(backward, n, DRILL_ROW_CORE + state), 1e-9);
}

TEST(DrillDriver, CoastingTakesNothingFromTheSupply) {
    DrillParameters p;
    p.pulse = 1.0;
    const DrillRun run = run_of(p, DrillSolver::REFERENCE, 0.0, 1e-4);
    std::size_t coasting = 0;
    for (std::size_t n = 1; n < rows_of(run); ++n) {
        if (at(run, n, DRILL_ROW_CONTROL) != 1.0 || at(run, n - 1, DRILL_ROW_CONTROL) != 1.0)
            continue;
        ++coasting;
        ASSERT_LE(at(run, n, DRILL_ROW_STORED), at(run, n - 1, DRILL_ROW_STORED) + 1e-9);
        ASSERT_LE(at(run, n, DRILL_ROW_SUMS + DRILL_WORK_IN),
                  at(run, n - 1, DRILL_ROW_SUMS + DRILL_WORK_IN) + 1e-12);
        ASSERT_GE(at(run, n, DRILL_ROW_CORE + DRILL_CURRENT), 0.0);
    }
    EXPECT_NEAR(static_cast<double>(coasting) * 1e-4, 11 * 0.025, 0.005);  // 11 coasts of 25 ms
}

// Central differences of the rates in every mode
TEST(DrillDriver, SlopesAreThoseOfTheRates) {
    DrillParameters p;
    p.load_viscous = 0.01;
    const DrillVector x{12.0, 700.0, 1e-3, 0.07};
    for (int number = 0; number < 24; ++number) {
        DrillMode m;
        m.slide = number % 2;
        m.clutch = number / 2 % 2;
        m.bridge = static_cast<DrillBridge>(number / 4 % 3);
        m.diode = m.bridge == DrillBridge::DIODES ? -1 : 0;
        p.exponential = number < 12 ? 0.0 : 1.0;
        const DrillInput in{m.bridge == DrillBridge::BLOCKED ? 0.0 : 11.0, 0.0, 6.0};
        const DrillSlopes j = drill_slopes(p, m, in, x);
        for (int n = 0; n < DRILL_CORE_COUNT; ++n) {
            const double e = 1e-6 * drill_scales(p)[n];
            const DrillRates high = drill_rates(p, m, in, x + e * DrillVector::Unit(n)),
                             low = drill_rates(p, m, in, x - e * DrillVector::Unit(n));
            const double core = ((high.core - low.core) / (2.0 * e) - j.core.col(n)).norm(),
                         sums = ((high.sums - low.sums) / (2.0 * e) - j.sums.col(n)).norm();
            EXPECT_LE(core, 1e-5 * j.core.col(n).norm() + 1e-9) << number << " by " << n;
            EXPECT_LE(sums, 1e-5 * j.sums.col(n).norm() + 1e-9) << number << " by " << n;
        }
    }
}

TEST(DrillDriver, ReferenceErrorFollowsItsTolerance) {
    DrillParameters p;
    p.pulse = 1.0;
    DrillRequest r;
    r.row_s = 1e-3;
    r.tolerance = 1e-10;
    const DrillRun best = drill_run(p, r);
    double error[3], steps[3];
    for (int n = 0; n < 3; ++n) {
        r.tolerance = std::pow(10.0, -4 - 2 * n);
        const DrillRun run = drill_run(p, r);
        steps[n] = static_cast<double>(run.steps.size());
        error[n] = 0.0;
        for (std::size_t row = 0; row < rows_of(best); ++row)
            error[n] = std::max(error[n], std::fabs(at(run, row, DRILL_ROW_CORE + DRILL_SPEED) -
                                                    at(best, row, DRILL_ROW_CORE + DRILL_SPEED)));
    }
    EXPECT_LT(error[1], 0.1 * error[0]);
    EXPECT_LT(error[2], 0.1 * error[1]);
    EXPECT_LT(error[2], 1e-6 * p.supply_v / p.constant);
    EXPECT_LT(steps[2], 15.0 * steps[1]);  // smooth motion: order 4 needs 100^(1/4) = 3.2 times the
                                           // steps for a hundredth of the error
}

// Every change of mode is in the record of steps, and the steps add to the run.
TEST(DrillDriver, StepsAddToTheRun) {
    DrillParameters p;
    p.pulse = 1.0;
    const DrillRun run = run_of(p, DrillSolver::REFERENCE, 0.0, 0.0);
    double total = 0.0;
    for (const DrillStep &step : run.steps)
        total += step.length_s;
    EXPECT_NEAR(total, 4.0, 1e-9);
    EXPECT_EQ(run.steps.size() + 1, rows_of(run));
    EXPECT_EQ(std::count_if(run.steps.begin(), run.steps.end(),
                            [](const DrillStep &s) { return s.mark == DrillMark::LOAD_ON; }),
              1);
    EXPECT_EQ(std::count_if(run.marks.begin(), run.marks.end(),
                            [](const DrillStep &s) { return s.mark == DrillMark::PULSE_ON; }),
              1);
}

TEST(DrillDriver, RealTimeWorkIsBounded) {
    DrillParameters p;
    p.pulse = 1.0;
    p.clutch_nm = 4.0;
    p.load_nm = 40.0;
    for (const double step_s : {35e-6, 1e-3, 0.1}) {
        DrillRealTime solver(p, step_s);
        int most = 0;
        for (int n = 0; n < static_cast<int>(4.0 / step_s); ++n) {
            solver.step();
            most = std::max(most, solver.advances());
        }
        EXPECT_LE(most, solver.advances_max());
        EXPECT_GT(most, static_cast<int>(step_s / 100e-6));
    }
}

TEST(DrillDriver, BadParametersAreNamed) {
    for (const DrillParameter &entry : DRILL_PARAMETERS) {
        DrillParameters p;
        p.*entry.member = std::nan("");
        try {
            run_of(p, DrillSolver::EULER, 1e-5, 1.0);
            FAIL() << entry.name;
        } catch (const std::invalid_argument &error) {
            EXPECT_NE(std::string(error.what()).find(entry.name), std::string::npos);
        }
    }
    DrillParameters p;
    p.shaft_damping = 0.0;
    EXPECT_THROW(drill_check(p), std::invalid_argument);
    EXPECT_THROW(run_of(DrillParameters(), DrillSolver::RK4, 0.0, 1.0), std::invalid_argument);
}

TEST(FrictionLaw, SlopesAreThoseOfTheTorques) {
    const FrictionLaw<double> law{7.2, 6.0, 0.05, 0.1, 0.02, 40.0};
    for (const double w : {-3.0, -0.1, -0.004, 0.0, 0.011, 0.05, 0.3, 20.0}) {
        const double e = 1e-7;
        EXPECT_NEAR(friction_law_stribeck_slope<double>(law, w),
                    (friction_law_stribeck<double>(law, w + e) -
                     friction_law_stribeck<double>(law, w - e)) /
                        (2 * e),
                    1e-4);
        EXPECT_NEAR(friction_law_exponential_slope<double>(law, w),
                    (friction_law_exponential<double>(law, w + e) -
                     friction_law_exponential<double>(law, w - e)) /
                        (2 * e),
                    1e-4);
    }
}
