// Laws of the closed loop, whatever the controller: nothing drives before, after or against the
// trigger, and a run can be repeated to the byte.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "hal/sim/sim.h"
#include "plant/lockstep/drive_plant.hpp"
#include "reference_tool.hpp"

namespace {

constexpr double SUPPLY_V = 18.5;
constexpr double RPM = 30.0 / 3.14159265358979;
constexpr int PERIODS_PER_MS = 31;  // 31.37, rounded down

// The reference drive (docs/spec/model.md, section 4) without its mechanism: hammer and anvil turn
// with the spindle.
vgroove::Parameters reference() {
    vgroove::Parameters p = reference_tool();
    p.gearbox_output_inertia = 6e-5;
    return p;
}

struct Row {
    bool coast;
    int compare;
    double current_a;
    double speed_rpm;
};

// Board and tool in lock-step; hold() drives them and keeps a row for each millisecond.
class Loop {
public:
    explicit Loop(vgroove::LoadKind load = vgroove::LoadKind::NONE)
        : tool_(reference(), load, vgroove::hall_wheel(4, 0.3, {}), 1) {
        const SimStart start = SIM_START_DEFAULT;
        sim_reset(&start, &out_);
    }

    void hold(double travel, bool reverse, int milliseconds, double load_nm = 0.0,
              double added_a = 0.0) {
        for (int k = 0; k < milliseconds * PERIODS_PER_MS; ++k) {
            period(travel, reverse, load_nm, added_a);
            if (k % PERIODS_PER_MS == 0) {
                rows.push_back(
                    {out_.coast != 0, out_.compare, tool_.current_a(), tool_.speed_rad_s() * RPM});
            }
        }
    }

    std::vector<Row> rows;
    std::vector<std::uint8_t> sent;

private:
    void period(double travel, bool reverse, double load_nm, double added_a) {
        const bool switching = out_.compare != 0 && std::abs(out_.compare) < 255;
        const auto result = tool_.period(out_.coast != 0, out_.compare / 255.0,
                                         switching ? out_.dead_counts / 510.0 : 0.0, load_nm);
        SimInputs in{};
        in.adc_counts[SIM_ADC_CURRENT] = static_cast<std::uint16_t>(
            std::clamp(512.5 + (result.current_a + added_a) / 0.125, 0.0, 1023.0));
        in.adc_counts[SIM_ADC_BUS] = static_cast<std::uint16_t>(result.supply_v / 0.025 + 0.5);
        in.adc_counts[SIM_ADC_TRIGGER] =
            static_cast<std::uint16_t>((0.1 + 0.8 * travel) * 1023.0 + 0.5);
        in.adc_counts[SIM_ADC_TEMPERATURE] = 154;  // counts at 25 degC
        in.switches = static_cast<std::uint8_t>((travel > 0.02 ? SIM_SWITCH_CONTACT : 0) |
                                                (reverse ? SIM_SWITCH_REVERSE : 0));
        in.edge_count = static_cast<std::uint8_t>(result.edge_count);
        for (int k = 0; k < result.edge_count; ++k) {
            in.edge_cycle[k] = static_cast<std::uint16_t>(result.edge_cycle[k]);
        }
        sim_period(&in, &out_);
        sent.insert(sent.end(), out_.tx, out_.tx + out_.tx_count);
    }

    vgroove::DrivePlant tool_;
    SimOutputs out_{};
};

TEST(Sil, BridgeIsOpenUntilTheTriggerIsPulled) {
    Loop loop;
    loop.hold(0.0, false, 500);
    for (const Row &row : loop.rows) {
        ASSERT_TRUE(row.coast);
    }
}

TEST(Sil, FullTriggerReachesTheNoLoadSpeed) {
    Loop loop;
    loop.hold(0.0, false, 300);
    loop.hold(1.0, false, 1200);
    EXPECT_NEAR(loop.rows.back().speed_rpm, 2813.0 * 5.6,
                2813.0 * 5.6 * 0.005);  // docs/spec/model.md, section 4
    EXPECT_NEAR(loop.rows.back().current_a, 1.8, 0.1);
    EXPECT_EQ(loop.rows.back().compare, 255);
}

TEST(Sil, ReverseIsTheMirrorOfForward) {
    Loop forward;
    forward.hold(0.0, false, 300);
    forward.hold(0.6, false, 800);
    Loop reverse;
    reverse.hold(0.0, true, 300);
    reverse.hold(0.6, true, 800);
    EXPECT_NEAR(reverse.rows.back().speed_rpm, -forward.rows.back().speed_rpm, 30.0);
    EXPECT_EQ(reverse.rows.back().compare, -forward.rows.back().compare);
}

TEST(Sil, NothingDrivesAfterRelease) {
    Loop loop;
    loop.hold(0.0, false, 300);
    loop.hold(1.0, false, 700);
    loop.hold(0.0, false, 60);  // debounce and what the release may take
    const std::size_t begin = loop.rows.size();
    loop.hold(0.0, false, 1000);
    for (std::size_t k = begin; k < loop.rows.size(); ++k) {
        ASSERT_TRUE(loop.rows[k].coast) << k;
        ASSERT_LE(loop.rows[k].speed_rpm, loop.rows[k - 1].speed_rpm + 1e-6) << k;
    }
}

TEST(Sil, DirectionChangesOnlyAtStandstill) {
    Loop loop;
    loop.hold(0.0, false, 300);
    loop.hold(1.0, false, 600);
    loop.hold(1.0, true, 300);
    loop.hold(0.0, true, 100);
    loop.hold(1.0, true, 300);  // still turning: the release coasts
    for (const Row &row : loop.rows) {
        ASSERT_FALSE(row.compare < 0 && row.speed_rpm > 300.0)
            << row.compare << " at " << row.speed_rpm << " rpm";
    }
}

TEST(Sil, OverCurrentOpensTheBridgeUntilTheTriggerIsReleased) {
    Loop loop;
    loop.hold(0.0, false, 300);
    loop.hold(1.0, false, 500);
    loop.hold(1.0, false, 3, 0.0, 62.0);
    EXPECT_TRUE(loop.rows.back().coast);
    loop.hold(1.0, false, 500);
    EXPECT_TRUE(loop.rows.back().coast);
    loop.hold(0.0, false, 300);
    loop.hold(0.8, false, 300);
    EXPECT_FALSE(loop.rows.back().coast);
}

TEST(Sil, SameInputsGiveTheSameBytes) {
    std::vector<std::uint8_t> sent[2];
    for (auto &bytes : sent) {
        Loop loop;
        loop.hold(0.0, false, 200);
        loop.hold(0.7, false, 400);
        bytes = loop.sent;
    }
    EXPECT_GT(sent[0].size(), 10000u);
    EXPECT_EQ(sent[0], sent[1]);
}

}  // namespace
