// Orders to the bridge, see h_bridge.h.
#include "drivers/h_bridge.h"

#include "core/fixed.h"
#include "core/units.h"
#include "hal/hal.h"

#define TICK_REST_CYCLES (HAL_CYCLES_PER_TICK % HAL_CYCLES_PER_PERIOD)  // beyond whole periods

// Cycles to the first TOP after a tick, from those of the tick before it.
static uint16_t top_after(uint16_t cycles_to_top) {
    uint16_t cycles = cycles_to_top;
    if (cycles < TICK_REST_CYCLES) {
        cycles = (uint16_t)(cycles + HAL_CYCLES_PER_PERIOD);
    }
    return (uint16_t)(cycles - TICK_REST_CYCLES);
}

void h_bridge_init(HBridge *self, uint8_t dead_counts) {
    *self = (HBridge){.staged = {.phase = H_BRIDGE_OPEN},
                      .cycles_to_top = top_after(HAL_FIRST_TOP_CYCLES),
                      .staged_compare = H_BRIDGE_COAST,
                      .next_compare = H_BRIDGE_COAST,
                      .row_compare = H_BRIDGE_COAST,
                      .dead_counts = dead_counts};
}

int16_t h_bridge_compare(int16_t duty_q15) {
    const uint16_t magnitude = (uint16_t)(duty_q15 < 0 ? -(int32_t)duty_q15 : duty_q15);
    uint32_t full_q15 = (uint32_t)magnitude << 8;  // 256, less 1: a move of bytes
    FIXED_HIDE(full_q15);
    full_q15 = 2u * (full_q15 - magnitude + 0x4000u);
    const int16_t compare = (int16_t)(full_q15 >> (UNITS_DUTY_Q + 1u));
    return (int16_t)(duty_q15 < 0 ? -compare : compare);
}

void h_bridge_leg_a(HBridgeOrder *order, uint8_t compare, uint8_t dead_counts) {
    const uint8_t below = (uint8_t)(dead_counts / 2u);
    const uint8_t above = (uint8_t)(dead_counts - below);
    if (compare == 0u || compare == HAL_COMPARE_MAX) {
        order->high_below = compare;
        order->low_above = compare;
        return;
    }
    order->high_below = (uint8_t)(compare > below ? compare - below : 0);
    order->low_above =
        (uint8_t)(compare < HAL_COMPARE_MAX - above ? compare + above : HAL_COMPARE_MAX);
}

void h_bridge_next_row(HBridge *self) {
    self->row_compare = self->next_compare;
    self->next_compare = self->staged_compare;
    self->cycles_to_top = top_after(self->cycles_to_top);
}

static HBridgePhase next_phase(const HBridge *self, bool leg_b_high) {
    if (self->staged.phase == H_BRIDGE_OPEN) {
        return H_BRIDGE_ARMED;
    }
    return self->staged.leg_b_high == leg_b_high ? H_BRIDGE_DRIVING : H_BRIDGE_OPEN;
}

// At full duty leg A does not switch. Entering or leaving it directly would turn one side on at the
// TOP at which the other turns off. The compare value next to full duty, at which the low side is
// off already and the high side keeps its dead time, is applied in between.
static int16_t leg_a_reached(const HBridge *self, int16_t wanted) {
    const int16_t beside_full =
        (int16_t)(HAL_COMPARE_MAX - (self->dead_counts - self->dead_counts / 2u));
    const bool full = self->staged.high_below == HAL_COMPARE_MAX;
    const bool low_rests = self->staged.low_above == HAL_COMPARE_MAX;
    const bool driving = self->staged.phase == H_BRIDGE_DRIVING;
    if (wanted <= beside_full) {
        return driving && full ? beside_full : wanted;
    }
    return wanted == HAL_COMPARE_MAX && (!driving || low_rests) ? wanted : beside_full;
}

static HBridgeOrder order_of(const HBridge *self, int16_t compare) {
    HBridgeOrder order = {.phase = H_BRIDGE_OPEN, .leg_b_high = self->staged.leg_b_high};
    if (compare == H_BRIDGE_COAST) {
        return order;
    }
    if (compare != 0) {
        order.leg_b_high = compare < 0;
    }
    order.phase = (uint8_t)next_phase(self, order.leg_b_high);
    order.compare = compare;
    if (order.phase == H_BRIDGE_DRIVING) {
        const int16_t below = order.leg_b_high ? HAL_COMPARE_MAX : 0;
        const int16_t leg_a = leg_a_reached(self, (int16_t)(compare + below));
        order.compare = (int16_t)(leg_a - below);
        h_bridge_leg_a(&order, (uint8_t)leg_a, self->dead_counts);
    }
    return order;
}

void h_bridge_stage(HBridge *self, int16_t compare) {
    if (self->staged.phase == H_BRIDGE_DRIVING && self->staged.compare == compare &&
        self->staged_compare == compare) {
        hal_apply_at(self->cycles_to_top < HAL_APPLY_MARGIN_CYCLES);
        return;  // order unchanged
    }
    const HBridgeOrder order = order_of(self, compare);
    self->staged_compare = order.phase == H_BRIDGE_DRIVING ? order.compare : H_BRIDGE_COAST;
    const uint8_t lock = hal_lock();
    self->staged = order;
    hal_apply_at(self->cycles_to_top < HAL_APPLY_MARGIN_CYCLES);
    hal_unlock(lock);
}

void h_bridge_note_trip(HBridge *self) {
    self->row_compare = H_BRIDGE_COAST;
    self->next_compare = H_BRIDGE_COAST;
}

void h_bridge_clear_trip(HBridge *self) {
    self->tripped = false;
}

void h_bridge_on_apply(const HBridge *self) {
    if (self->tripped || self->staged.phase == H_BRIDGE_OPEN) {
        hal_bridge_open();
    } else if (self->staged.phase == H_BRIDGE_ARMED) {
        hal_bridge_arm(self->staged.leg_b_high);
    } else {
        hal_bridge_set(self->staged.high_below, self->staged.low_above);
    }
}

void h_bridge_on_trip(HBridge *self) {
    self->tripped = true;
    hal_bridge_cut();
}
