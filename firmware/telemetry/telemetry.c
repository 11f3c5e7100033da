// Schedule of the frames and byte budget, see telemetry.h.
#include "telemetry/telemetry.h"

#include "core/crc.h"
#include "core/divide.h"
#include "core/inline.h"

#define FRAME_START 0xAAu
#define FRAME_END 0xBBu
#define DATA_AT 10u  // after start, time, length and id
// Budgets are in 1/100 byte.
#define FRAME_COST (100u * TELEMETRY_FRAME_BYTES)
#define BUDGET_MAX (100u * TELEMETRY_QUEUE_BYTES)
#define TRIGGER_STEP 2u  // smaller changes of the trigger are ADC noise
#define MS_PER_SECOND 1000u

// Kinds of slow frames; they take turns, so that none delays the others indefinitely.
enum { TURN_STATE, TURN_CONTROL, TURN_OTHER, TURNS };

#define BUDGET_PER_TICK_250000 2500u
#define BUDGET_PER_TICK_115200 1152u
// Least number of ticks between FAST frames that leaves bytes for slow frames.
#define DIVIDER_LEAST_250000 1u
#define DIVIDER_LEAST_115200 2u

static void finish_frame(uint8_t frame[TELEMETRY_FRAME_BYTES], uint16_t id, uint8_t crc_seed,
                         uint32_t now_ms) {
    frame[0] = FRAME_START;
    frame[1] = (uint8_t)now_ms;
    frame[2] = (uint8_t)(now_ms >> 8);
    frame[3] = (uint8_t)(now_ms >> 16);
    frame[4] = (uint8_t)(now_ms >> 24);
    frame[5] = TELEMETRY_DATA_BYTES;
    frame[6] = (uint8_t)id;
    frame[7] = (uint8_t)(id >> 8);
    frame[8] = 0u;
    frame[9] = 0u;
    const uint8_t crc = crc8_over_frame(crc_seed, &frame[1], &frame[DATA_AT]);
    frame[DATA_AT + TELEMETRY_DATA_BYTES - 1u] = (uint8_t)(crc ^ CRC8_FINAL_XOR);
    frame[TELEMETRY_FRAME_BYTES - 1u] = FRAME_END;
}

void telemetry_dump(Telemetry *self) {
    self->boot_pending = true;
    self->dump_next = 0;
    self->dump_crc16 = CRC16_INIT;
    self->crc_pending = false;
    self->control_pending = true;
    self->turn = TURN_STATE;
    self->ms_in_second = MS_PER_SECOND - 1u;  // STATE and HEALTH are sent too
}

void telemetry_read(Telemetry *self, uint8_t index) {
    self->read_index = index;
}

void telemetry_ack(Telemetry *self, const TelemetryAck *ack) {
    self->ack = *ack;
    self->ack_pending = true;
}

bool telemetry_ack_pending(const Telemetry *self) {
    return self->ack_pending;
}

static bool to_be_packed(const Telemetry *self) {
    return self->state_pending || self->control_pending || self->boot_pending ||
           self->ack_pending || self->health_pending || self->dump_next != TELEMETRY_NONE ||
           self->read_index != TELEMETRY_NONE;
}

bool telemetry_packs(const Telemetry *self) {
    return self->crc_pending ||
           (self->budget + self->budget_per_tick >= BUDGET_MAX && to_be_packed(self));
}

bool telemetry_sends_slow(const Telemetry *self) {
    return self->slow_packed;
}

bool telemetry_health_due(const Telemetry *self) {
    return self->health_pending || self->ms_in_second >= MS_PER_SECOND - 1u;
}

bool telemetry_health_sent(const Telemetry *self) {
    return self->health_packed;
}

// A move of at least TRIGGER_STEP, or one to an end of the travel.
static bool trigger_moved(uint8_t before, uint8_t now) {
    const uint8_t distance = (uint8_t)(before > now ? before - now : now - before);
    return distance >= TRIGGER_STEP ||
           (distance > 0u && (now == 0u || now == TELEMETRY_TRIGGER_MAX));
}

// The flags of a frame that has not been packed yet are kept in the updated one.
static void note_state(Telemetry *self, const TelemetryInputs *in) {
    const uint16_t flags =
        self->state_pending ? in->state.flags | self->state.flags : in->state.flags;
    if (!trigger_moved(self->state.trigger, in->state.trigger) &&
        !TELEMETRY_STATE_CHANGED(&self->state, &in->state) && self->state.flags == flags) {
        return;
    }
    TELEMETRY_STATE_COPY(&self->state, &in->state);
    self->state.flags = flags;
    self->state.state_tick = (uint8_t)in->now_ms;
    self->state_pending = true;
}

static void note_control(Telemetry *self, const TelemetryInputs *in) {
    const TelemetryControl *now = &in->control;
    if (!TELEMETRY_CONTROL_CHANGED(&self->control, now)) {
        return;
    }
    self->control = *now;
    self->control.control_tick = (uint8_t)in->now_ms;
    self->control_pending = true;
}

static void note_second(Telemetry *self, uint32_t now_ms) {
    self->ms_in_second++;
    if (self->ms_in_second < MS_PER_SECOND) {
        return;
    }
    self->ms_in_second = 0;
    self->health_pending = true;
    if (!self->state_pending) {
        self->state.state_tick = (uint8_t)now_ms;
        self->state_pending = true;
    }
}

static int16_t mean_of(int32_t sum, uint8_t count) {
    const uint16_t mean =
        divide_by_u16((uint32_t)(sum < 0 ? -sum : sum) + (uint32_t)count / 2u, count);
    return (int16_t)(sum < 0 ? -(int32_t)mean : (int32_t)mean);
}

static void accumulate(Telemetry *self, const TelemetryFast *fast) {
    self->current_sum += fast->current_a;
    self->supply_sum = (uint16_t)(self->supply_sum + fast->supply_v);
}

static void take_means(Telemetry *self, TelemetryFast *fast) {
    const uint8_t ticks = self->boot.fast_divider;
    fast->current_a = mean_of(self->current_sum, ticks);
    fast->supply_v = divide_by_u16(self->supply_sum + ticks / 2u, ticks);
    self->current_sum = 0;
    self->supply_sum = 0;
}

static void send_fast(Telemetry *self, const TelemetryFast *now, uint32_t now_ms,
                      uint8_t frame[TELEMETRY_FRAME_BYTES]) {
    TelemetryFast fast = {now->current_a, now->speed_rpm, now->duty_compare, now->supply_v,
                          self->fast_counter};
    if (self->boot.fast_divider > 1u) {
        take_means(self, &fast);
    }
    self->fast_counter = (uint8_t)((self->fast_counter + 1u) & TELEMETRY_FAST_COUNTER_MAX);
    self->ticks_to_fast = self->boot.fast_divider;
    telemetry_pack_fast(&frame[DATA_AT], &fast);
    finish_frame(frame, TELEMETRY_FAST_ID, TELEMETRY_FAST_CRC_SEED, now_ms);
}

static void name_slow(Telemetry *self, uint16_t id, uint8_t crc_seed) {
    self->slow_id = id;
    self->slow_crc_seed = crc_seed;
}

static void pack_state(Telemetry *self) {
    telemetry_pack_state(self->slow, &self->state);
    name_slow(self, TELEMETRY_STATE_ID, TELEMETRY_STATE_CRC_SEED);
    self->state.state_counter =
        (uint8_t)((self->state.state_counter + 1u) & TELEMETRY_STATE_COUNTER_MAX);
    self->state_pending = false;
}

static void pack_control(Telemetry *self) {
    telemetry_pack_control(self->slow, &self->control);
    name_slow(self, TELEMETRY_CONTROL_ID, TELEMETRY_CONTROL_CRC_SEED);
    self->control_pending = false;
}

static void pack_param(Telemetry *self, uint8_t index, const TelemetryInputs *in) {
    const TelemetryParam param = {.param_index = index,
                                  .param_count = in->params.count,
                                  .param_value = in->params.value[index]};
    telemetry_pack_param(self->slow, &param);
    name_slow(self, TELEMETRY_PARAM_ID, TELEMETRY_PARAM_CRC_SEED);
}

// Adds the last parameter to the CRC of the dump; a tick of its own, as it costs as much as a
// frame.
static void take_dumped(Telemetry *self) {
    const uint8_t sign =
        self->dumped_value < 0 ? UINT8_MAX : 0u;  // upper bytes of the 32-bit value
    uint16_t crc = crc16_next(self->dump_crc16, (uint8_t)(self->dump_next - 1u));
    crc = crc16_next(crc, (uint8_t)self->dumped_value);
    crc = crc16_next(crc, (uint8_t)((uint16_t)self->dumped_value >> 8));
    crc = crc16_next(crc, sign);
    self->dump_crc16 = crc16_next(crc, sign);
    self->crc_pending = false;
}

static void pack_dumped_param(Telemetry *self, const TelemetryInputs *in) {
    pack_param(self, self->dump_next, in);
    self->dumped_value = in->params.value[self->dump_next];
    self->crc_pending = true;
    self->dump_next++;
}

static void pack_table(Telemetry *self, const TelemetryInputs *in) {
    TelemetryParamTable table = in->params.table;
    table.table_count = in->params.count;
    table.table_crc16 = self->dump_crc16;
    telemetry_pack_param_table(self->slow, &table);
    name_slow(self, TELEMETRY_PARAM_TABLE_ID, TELEMETRY_PARAM_TABLE_CRC_SEED);
    self->dump_next = TELEMETRY_NONE;
}

// Packs the next parameter frame, if one is requested.
static bool pack_any_param(Telemetry *self, const TelemetryInputs *in) {
    if (self->read_index < in->params.count) {
        pack_param(self, self->read_index, in);
        self->read_index = TELEMETRY_NONE;
        return true;
    }
    if (self->dump_next < in->params.count) {
        pack_dumped_param(self, in);
        return true;
    }
    if (self->dump_next != TELEMETRY_NONE) {
        pack_table(self, in);
        return true;
    }
    return false;
}

static void pack_boot(Telemetry *self) {
    telemetry_pack_boot(self->slow, &self->boot);
    name_slow(self, TELEMETRY_BOOT_ID, TELEMETRY_BOOT_CRC_SEED);
    self->boot_pending = false;
}

static void pack_ack(Telemetry *self) {
    telemetry_pack_ack(self->slow, &self->ack);
    name_slow(self, TELEMETRY_ACK_ID, TELEMETRY_ACK_CRC_SEED);
    self->ack_pending = false;
}

static void pack_health(Telemetry *self, const TelemetryInputs *in) {
    telemetry_pack_health(self->slow, &in->health);
    name_slow(self, TELEMETRY_HEALTH_ID, TELEMETRY_HEALTH_CRC_SEED);
    self->health_pending = false;
    self->health_packed = true;
}

// Packs a slow frame that is neither STATE nor CONTROL, if one is pending.
static bool pack_other(Telemetry *self, const TelemetryInputs *in) {
    if (self->ack_pending) {
        pack_ack(self);
        return true;
    }
    if (self->health_pending) {
        pack_health(self, in);
        return true;
    }
    return pack_any_param(self, in);
}

static bool pack_of_turn(Telemetry *self, uint8_t turn, const TelemetryInputs *in) {
    if (turn == TURN_OTHER) {
        return pack_other(self, in);
    }
    if (turn == TURN_STATE && self->state_pending) {
        pack_state(self);
        return true;
    }
    if (turn == TURN_CONTROL && self->control_pending) {
        pack_control(self);
        return true;
    }
    return false;
}

// Data of one slow frame; at least one is pending.
INLINE_NEVER static void pack_slow(Telemetry *self, const TelemetryInputs *in) {
    BY_POINTER(self);
    self->slow_packed = true;
    if (self->boot_pending) {
        pack_boot(self);
        return;
    }
    for (uint8_t k = 0; k < TURNS; k++) {
        const uint8_t turn = self->turn;
        self->turn = (uint8_t)(turn < TURNS - 1u ? turn + 1u : 0u);
        if (pack_of_turn(self, turn, in)) {
            return;
        }
    }
}

static void send_slow(Telemetry *self, uint32_t now_ms, uint8_t frame[TELEMETRY_FRAME_BYTES]) {
    for (uint8_t k = 0; k < TELEMETRY_DATA_BYTES; k++) {
        frame[DATA_AT + k] = self->slow[k];
    }
    finish_frame(frame, self->slow_id, self->slow_crc_seed, now_ms);
    self->slow_packed = false;
}

void telemetry_init(Telemetry *self, const TelemetryBoot *boot, uint8_t baud) {
    const bool slow_line = baud == TELEMETRY_BAUD_115200;
    const uint8_t least = slow_line ? DIVIDER_LEAST_115200 : DIVIDER_LEAST_250000;
    *self = (Telemetry){.boot = *boot, .budget = BUDGET_MAX, .read_index = TELEMETRY_NONE};
    self->budget_per_tick = slow_line ? BUDGET_PER_TICK_115200 : BUDGET_PER_TICK_250000;
    self->boot.protocol_version = TELEMETRY_PROTOCOL_VERSION;
    self->boot.fast_divider = boot->fast_divider < least ? least : boot->fast_divider;
    self->ticks_to_fast = self->boot.fast_divider;
    telemetry_dump(self);
    pack_boot(self);  // sent in the first tick, before all others
    self->slow_packed = true;
}

// A slow frame takes two ticks, one for its data and one for CRC and header. It begins when the
// budget is full: no FAST frame waits for it, and no transmit interrupts occur in its ticks.
// Returns the number of complete frames.
static uint8_t step_slow(Telemetry *self, const TelemetryInputs *in,
                         uint8_t frame[TELEMETRY_FRAME_BYTES]) {
    if (self->slow_packed) {
        send_slow(self, in->now_ms, frame);
        self->budget = (uint16_t)(self->budget - FRAME_COST);
        return 1;
    }
    if (self->crc_pending) {
        take_dumped(self);
    } else if (self->budget == BUDGET_MAX && to_be_packed(self)) {
        pack_slow(self, in);
    }
    return 0;
}

uint8_t telemetry_tick(Telemetry *self, const TelemetryInputs *in, const TelemetryFast *fast,
                       uint8_t out[TELEMETRY_TICK_BYTES_MAX]) {
    uint8_t *const place[2] = {out, &out[TELEMETRY_FRAME_BYTES]};
    return (uint8_t)(telemetry_frames(self, in, fast, place) * TELEMETRY_FRAME_BYTES);
}

uint8_t telemetry_frames(Telemetry *self, const TelemetryInputs *in, const TelemetryFast *fast,
                         uint8_t *const place[2]) {
    uint8_t frames = 0;
    if (!in->hold_state) {
        note_state(self, in);
        note_control(self, in);
    }
    note_second(self, in->now_ms);
    self->health_packed = false;
    if (self->boot.fast_divider > 1u) {
        accumulate(self, fast);
    }
    self->ticks_to_fast--;
    self->budget = (uint16_t)(self->budget + self->budget_per_tick);
    if (self->budget > BUDGET_MAX) {
        self->budget = BUDGET_MAX;
    }
    const bool fast_due = self->ticks_to_fast == 0u;
    if (!in->hold_slow) {
        frames = step_slow(self, in, place[0]);
    }
    if (fast_due) {
        send_fast(self, fast, in->now_ms, place[frames]);
        self->budget = (uint16_t)(self->budget - FRAME_COST);
        frames++;
    }
    return frames;
}
