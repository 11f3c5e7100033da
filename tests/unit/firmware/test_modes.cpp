// State machine: every transition, and laws of all states.
#include <gtest/gtest.h>

extern "C" {
#include "app/modes.h"
}

namespace {

Modes in_state(ModesState state, bool armed = true, bool reverse = false) {
    Modes self{};
    self.state = static_cast<uint8_t>(state);
    self.armed = armed;
    self.reverse = reverse;
    return self;
}

constexpr ModesState ALL[] = {MODES_IDLE,  MODES_DRIVE,     MODES_RELEASE,
                              MODES_FAULT, MODES_CALIBRATE, MODES_STOPPED};

// Each member is a bit of the number.
ModesInputs inputs_of(unsigned bits) {
    return {(bits & 1) != 0,  (bits & 2) != 0,  (bits & 4) != 0,  (bits & 8) != 0,
            (bits & 16) != 0, (bits & 32) != 0, (bits & 64) != 0, (bits & 128) != 0};
}

void release_and_press(Modes *self, ModesInputs *m) {
    m->pressed = m->contact = false;
    modes_step(self, m);
    m->pressed = m->contact = true;
    modes_step(self, m);
}

TEST(Modes, AFaultHasPriorityInEveryStateAndOpensTheBridge) {
    for (const ModesState state : ALL) {
        for (unsigned bits = 0; bits < 256; ++bits) {
            ModesInputs m = inputs_of(bits);
            m.fault = true;
            m.fault_persists = true;
            Modes self = in_state(state);
            modes_step(&self, &m);
            ASSERT_EQ(self.state, MODES_FAULT);
            ASSERT_FALSE(self.armed);
            ASSERT_EQ(modes_output(&self, true), MODES_COMMAND_COAST);
        }
    }
}

TEST(Modes, NoMotoringCommandAfterRelease) {
    for (const ModesState state : ALL) {
        for (unsigned bits = 0; bits < 256; ++bits) {
            ModesInputs m = inputs_of(bits);
            m.pressed = false;
            Modes self = in_state(state);
            modes_step(&self, &m);
            ASSERT_NE(modes_output(&self, false), MODES_COMMAND_DRIVE);
        }
    }
}

TEST(Modes, TheDirectionChangesAtStandstillOnly) {
    for (const ModesState state : ALL) {
        for (unsigned bits = 0; bits < 256; ++bits) {
            const ModesInputs m = inputs_of(bits);
            Modes self = in_state(state);
            modes_step(&self, &m);
            ASSERT_TRUE(!self.reverse || (m.standstill && self.state == MODES_IDLE));
        }
    }
}

TEST(Modes, StartsOnlyArmed) {
    Modes self = in_state(MODES_IDLE, false);
    ModesInputs m{};
    m.pressed = m.contact = m.standstill = true;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_IDLE) << "trigger held since the start";
    release_and_press(&self, &m);
    EXPECT_EQ(self.state, MODES_DRIVE);
}

TEST(Modes, ADirectionSwitchReleasesTheDriveUntilTheTriggerIsPressedAgain) {
    Modes self = in_state(MODES_DRIVE);
    ModesInputs m{};
    m.pressed = m.contact = m.reverse_switch = true;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_RELEASE);
    EXPECT_EQ(modes_output(&self, false), MODES_COMMAND_COAST);
    EXPECT_EQ(modes_output(&self, true), MODES_COMMAND_RAMP_DOWN);
    m.standstill = true;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_IDLE);
    EXPECT_TRUE(self.reverse);
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_IDLE) << "still pressed: not armed";
}

// The travel returns to the dead band with the contact closed, and the direction is switched.
TEST(Modes, ADriveInTheOtherDirectionNeedsAnOpenContact) {
    Modes self = in_state(MODES_DRIVE);
    ModesInputs m{};
    m.contact = true;
    modes_step(&self, &m);
    ASSERT_EQ(self.state, MODES_RELEASE);
    m.reverse_switch = true;
    modes_step(&self, &m);
    m.standstill = true;
    modes_step(&self, &m);
    ASSERT_EQ(self.state, MODES_IDLE);
    ASSERT_TRUE(self.reverse);
    m.pressed = true;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_IDLE) << "the contact was never open";
    release_and_press(&self, &m);
    EXPECT_EQ(self.state, MODES_DRIVE);
}

// In every state with every input: where the direction changes, the contact has been open.
TEST(Modes, ATakenDirectionIsArmedOnlyByAnOpenContact) {
    for (const ModesState state : ALL) {
        for (unsigned bits = 0; bits < 512; ++bits) {
            const ModesInputs m = inputs_of(bits & 255u);
            Modes self = in_state(state, true, bits > 255);
            modes_step(&self, &m);
            if (self.reverse != (bits > 255)) {
                ASSERT_TRUE(!self.armed || !m.contact) << state << ' ' << bits;
            }
        }
    }
}

// The switch is moved with an open contact while the shaft runs down.
TEST(Modes, APressDuringTheRunDownInTheOtherDirectionDoesNotCount) {
    ModesInputs m{};
    Modes self = in_state(MODES_RELEASE);
    m.reverse_switch = true;
    modes_step(&self, &m);
    m.contact = m.pressed = true;
    modes_step(&self, &m);
    m.standstill = true;
    for (int n = 0; n < 5; ++n) {
        modes_step(&self, &m);
        EXPECT_EQ(self.state, MODES_IDLE) << n;
    }
    release_and_press(&self, &m);
    EXPECT_EQ(self.state, MODES_DRIVE);
    EXPECT_TRUE(self.reverse);
}

TEST(Modes, AStoppedDriveStaysOpenUntilTheContactOpens) {
    Modes self = in_state(MODES_DRIVE);
    ModesInputs m{};
    m.pressed = m.contact = m.stopped = true;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_STOPPED);
    EXPECT_EQ(modes_output(&self, true), MODES_COMMAND_COAST);
    m.stopped = false;
    m.pressed = false;  // travel in the dead band, contact closed
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_STOPPED);
    m.contact = false;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_IDLE);
    m.pressed = m.contact = m.standstill = true;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_DRIVE);
}

TEST(Modes, ResumesWhileTheShaftTurns) {
    Modes self = in_state(MODES_RELEASE);
    ModesInputs m{};
    m.pressed = m.contact = true;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_DRIVE);
}

TEST(Modes, AFaultIsClearedAtAReleasedTriggerWithoutItsCondition) {
    ModesInputs m{};
    m.fault = m.contact = m.standstill = true;
    Modes self = in_state(MODES_FAULT);
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_FAULT) << "trigger held";
    m.contact = false;
    m.fault_persists = true;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_FAULT) << "condition present";
    m.fault_persists = false;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_IDLE);
}

TEST(Modes, CalibratesAtStandstillUntilDone) {
    ModesInputs m{};
    m.calibrating = true;
    Modes self = in_state(MODES_IDLE);
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_IDLE);
    m.standstill = true;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_CALIBRATE);
    m.calibrating = false;
    modes_step(&self, &m);
    EXPECT_EQ(self.state, MODES_IDLE);
}

}  // namespace
