// ADC: slots, sampling schedule, samples of a tick, over-current trip in the interrupt.
#include <gtest/gtest.h>

extern "C" {
#include "drivers/adc_sequence.h"
#include "hal/hal.h"
}
#include "hal/native/native.h"

namespace {

struct Converter {
    AdcSequence adc{};
    uint32_t conversions = 0;

    Converter() {
        native_reset();
        adc_sequence_init(&adc);
    }

    // Runs the hardware up to the tick at cycle `tick`, with interrupts `late` cycles late.
    AdcTick tick(uint32_t tick, uint32_t late = 0) {
        while (HAL_FIRST_SAMPLE_CYCLES + 2040ull * conversions + late <= 16000ull * (tick + 1)) {
            adc_sequence_on_result(&adc, static_cast<uint16_t>(conversions % 1024));
            ++conversions;
        }
        AdcTick out;
        adc_sequence_tick(&adc, &out);
        return out;
    }
};

struct AdcTest : testing::Test, Converter {};

TEST_F(AdcTest, TwelveOfSixteenSlotsAreCurrent) {
    int slots[4] = {};
    for (uint8_t k = 0; k < ADC_SEQUENCE_SLOTS; ++k)
        ++slots[adc_sequence_channel(k)];
    EXPECT_EQ(slots[HAL_ADC_CURRENT], 12);
    EXPECT_EQ(slots[HAL_ADC_BUS], 2);
    EXPECT_EQ(slots[HAL_ADC_TRIGGER], 1);
    EXPECT_EQ(slots[HAL_ADC_TEMPERATURE], 1);
}

TEST_F(AdcTest, NextChannelIsKnownBeforeTheResult) {
    for (uint16_t k = 0; k < 600; ++k) {
        EXPECT_EQ(adc.head, k % 256);
        EXPECT_EQ(adc.next_channel, adc_sequence_channel(static_cast<uint8_t>(k + 1)));
        adc_sequence_on_result(&adc, 512);
        AdcTick out;
        if (k % 8 == 7)
            adc_sequence_tick(&adc, &out);
    }
}

// Condition for equal telemetry of native firmware and AVR.
TEST_F(AdcTest, SamplesOfATickDoNotDependOnLatency) {
    Converter late;
    for (uint32_t k = 0; k < 3000; ++k) {
        const AdcTick a = tick(k, 0);
        const AdcTick b = late.tick(k, HAL_LATENCY_CYCLES);
        ASSERT_FALSE(a.lost || b.lost) << k;
        ASSERT_EQ(a.current_sum, b.current_sum) << k;
        ASSERT_EQ(a.current_count, b.current_count) << k;
        ASSERT_EQ(a.fresh, b.fresh) << k;
    }
}

TEST_F(AdcTest, TakesSevenOrEightSamplesPerTickAndNoneIsLeft) {
    uint32_t taken = 0;
    for (uint32_t k = 0; k < 1020; ++k) {  // 8,000 conversions exactly
        const uint8_t before = adc.tail;
        tick(k);
        const uint8_t now_taken = static_cast<uint8_t>(adc.tail - before);
        ASSERT_TRUE(now_taken == 7 || now_taken == 8);
        taken += now_taken;
    }
    EXPECT_NEAR(taken, 8000, 1);
}

TEST_F(AdcTest, AMissedConversionIsDetectedAndTheScheduleContinues) {
    for (uint32_t k = 0; k < 20; ++k)
        EXPECT_FALSE(tick(k).lost);
    ++conversions;  // one result is missing
    int lost = 0;
    for (uint32_t k = 20; k < 200; ++k)
        lost += tick(k).lost ? 1 : 0;
    EXPECT_EQ(lost, 1);
}

TEST_F(AdcTest, AnOverflowIsDetectedAndTheSlotsStayAligned) {
    tick(0);
    for (int k = 0; k < 70; ++k)
        adc_sequence_on_result(&adc, 512);
    AdcTick out;
    adc_sequence_tick(&adc, &out);
    EXPECT_TRUE(out.lost);
    for (int k = 0; k < 16; ++k)
        adc_sequence_on_result(&adc, adc_sequence_channel(adc.head) == HAL_ADC_BUS ? 740 : 1);
    adc_sequence_tick(&adc, &out);
    EXPECT_TRUE((out.fresh & (1u << HAL_ADC_BUS)) == 0 || out.latest[HAL_ADC_BUS] == 740);
}

TEST_F(AdcTest, TripsJustBeyondTheLimitsAndOnlyForCurrent) {
    adc_sequence_set_trip(&adc, 112, 912);
    EXPECT_EQ(native.locks, 0);
    for (int k = 0; k < 64; ++k) {
        const bool current = adc_sequence_channel(static_cast<uint8_t>(k)) == HAL_ADC_CURRENT;
        const uint16_t counts[] = {111, 112, 912, 913};
        const uint16_t given = counts[k / 16];
        EXPECT_EQ(adc_sequence_on_result(&adc, given), current && (given < 112 || given > 912))
            << given;
        AdcTick out;
        if (k % 8 == 7)
            adc_sequence_tick(&adc, &out);
    }
}

TEST_F(AdcTest, TheTickReportsTheTripOfTheInterrupt) {
    adc_sequence_set_trip(&adc, 112, 912);
    for (uint32_t k = 0; k < 50; ++k) {
        bool interrupt = false;
        while (HAL_FIRST_SAMPLE_CYCLES + 2040ull * conversions <=
               16000ull * (k + 1) - HAL_LATENCY_CYCLES) {
            interrupt |= adc_sequence_on_result(&adc, conversions % 97 == 0 ? 913 : 500);
            ++conversions;
        }
        AdcTick out;
        adc_sequence_tick(&adc, &out);
        EXPECT_EQ(out.trips, interrupt) << k;
    }
}

}  // namespace
