// Exchange of a tick's inputs and its bridge command with a host, see inject.h.
#include "hal/inject/inject.h"

#include "core/crc.h"
#include "hal/hal.h"

#define FRAME_START 0xAAu
#define FRAME_END 0xBBu
#define TICK_AT 1u
#define LENGTH_AT 5u
#define ID_AT 6u
#define DATA_AT 10u
#define CRC_AT 17u
#define END_AT 18u
#define DATA_BYTES 8u
#define TICK_BYTES_MAX (3u * INJECT_FRAME)  // an answer and two frames of telemetry

#define PART_A 1u
#define PART_B 2u
#define PART_EDGES 4u
#define PACKED_HALF 5u  // bytes of four samples
#define COUNT_SHIFT 4u  // of the number of samples, above the switches

Inject inject;

// --- hal.h: gates and switches ---

void hal_bridge_cut(void) {
    inject.enabled = false;
    inject.armed = false;
}

void hal_bridge_open(void) {
    hal_bridge_cut();
    inject.high_below = 0;
    inject.low_above = HAL_COMPARE_MAX;
}

void hal_bridge_arm(bool leg_b_high) {
    inject.armed = true;
    inject.leg_b_high = leg_b_high;
}

void hal_bridge_set(uint8_t high_below, uint8_t low_above) {
    inject.high_below = high_below;
    inject.low_above = low_above;
    inject.enabled = inject.armed;
}

void hal_apply_at(bool later) {
    inject.apply_later = later;
}

uint8_t hal_switches(void) {
    return inject.switches;
}

void hal_uart_receive(bool on) {
    (void)on;  // the application's bytes come frame by frame, in step with its ticks
}

// --- frames from the host ---

static uint16_t half(const uint8_t *bytes) {
    return (uint16_t)(bytes[0] | (uint16_t)((uint16_t)bytes[1] << 8));
}

static uint32_t word(const uint8_t *bytes) {
    const uint32_t low = half(bytes);
    const uint32_t high = half(&bytes[2]);
    return low | (high << 16);
}

static void put_word(uint8_t *bytes, uint32_t value) {
    for (uint8_t k = 0; k < sizeof value; k++) {
        bytes[k] = (uint8_t)(value >> (uint8_t)(8u * k));
    }
}

static uint8_t crc_of(const uint8_t frame[INJECT_FRAME]) {
    const uint8_t crc = crc8_over(CRC8_INIT, &frame[ID_AT], DATA_AT - ID_AT);
    return (uint8_t)(crc8_over_frame(crc, &frame[TICK_AT], &frame[DATA_AT]) ^ CRC8_FINAL_XOR);
}

static void note_error(void) {
    inject.errors = (uint8_t)(inject.errors + (inject.errors < UINT8_MAX ? 1u : 0u));
}

// Slot for the inputs of a tick; those of another tick in it are overwritten.
static InjectInputs *slot_of(uint32_t tick) {
    InjectInputs *slot = &inject.inputs[(uint8_t)tick & 1u];
    if (slot->tick != tick) {
        *slot = (InjectInputs){.tick = tick};
    }
    return slot;
}

static bool complete(const InjectInputs *in) {
    const uint8_t wanted = in->edge_count > 0u ? PART_A | PART_B | PART_EDGES : PART_A | PART_B;
    return (in->parts & wanted) == wanted;
}

static void copy(uint8_t *to, const uint8_t *from, uint8_t count) {
    for (uint8_t k = 0; k < count; k++) {
        to[k] = from[k];
    }
}

static void take_part(InjectInputs *in, uint16_t id, const uint8_t data[DATA_BYTES]) {
    if (id == INJECT_ID_SENSE_A) {
        copy(in->packed, data, PACKED_HALF);
        in->switches = (uint8_t)(data[PACKED_HALF] & ((1u << COUNT_SHIFT) - 1u));
        in->sample_count = (uint8_t)(data[PACKED_HALF] >> COUNT_SHIFT);
        in->parts |= PART_A;
    } else if (id == INJECT_ID_SENSE_B) {
        copy(&in->packed[PACKED_HALF], data, PACKED_HALF);
        in->edge_count = data[PACKED_HALF];
        in->parts |= PART_B;
    } else {
        for (uint8_t k = 0; k < INJECT_EDGES; k++) {
            in->edge_cycle[k] = half(&data[2u * k]);
        }
        in->parts |= PART_EDGES;
    }
}

static bool plausible(const InjectInputs *in) {
    return in->sample_count <= INJECT_SAMPLES && in->edge_count <= INJECT_EDGES;
}

// The host asks for an answer again; of both last ones the older goes first.
static void note_repeat(uint32_t tick) {
    if (tick + 1u >= inject.done && (!inject.repeats || tick < inject.repeat_tick)) {
        inject.repeats = true;
        inject.repeat_tick = tick;
    }
}

// Tick 0 begins a run. Of the others only the two that follow the executed ones are taken.
static void take_sense(uint32_t tick, uint16_t id, const uint8_t data[DATA_BYTES]) {
    if (tick == 0u) {
        inject.restarts = inject.restarts || id == INJECT_ID_SENSE_A;
        return;
    }
    if (!inject.runs || tick > inject.done + 2u) {
        note_error();
        return;
    }
    if (tick <= inject.done) {
        note_repeat(tick);
        return;
    }
    InjectInputs *in = slot_of(tick);
    take_part(in, id, data);
    if (!plausible(in)) {
        note_error();
        *in = (InjectInputs){.tick = tick};
    } else if (complete(in) && tick > inject.latest) {
        inject.latest = tick;
    }
}

static void take_frame(void) {
    const uint8_t *frame = inject.frame;
    const uint16_t id = half(&frame[ID_AT]);
    if (id >= INJECT_ID_SENSE_A && id <= INJECT_ID_SENSE_EDGES) {
        take_sense(word(&frame[TICK_AT]), id, &frame[DATA_AT]);
    } else if (id >= INJECT_ID_COMMANDS && !inject.command_waits) {
        copy(inject.command, frame, INJECT_FRAME);
        inject.command_tick = inject.latest + 1u;
        inject.command_waits = true;
    } else {
        note_error();
    }
}

static bool intact(void) {
    const uint8_t *frame = inject.frame;
    return frame[END_AT] == FRAME_END && half(&frame[ID_AT + 2u]) == 0u &&
           crc_of(frame) == frame[CRC_AT];
}

// Whether the bytes so far can be the beginning of a frame.
static bool begins_frame(void) {
    const uint8_t *frame = inject.frame;
    return inject.count == 0u || (frame[0] == FRAME_START &&
                                  (inject.count <= LENGTH_AT || frame[LENGTH_AT] == DATA_BYTES));
}

static void resynchronise(void) {
    note_error();
    do {
        inject.count--;
        for (uint8_t k = 0; k < inject.count; k++) {
            inject.frame[k] = inject.frame[k + 1u];
        }
    } while (!begins_frame());
}

// Only the bytes that decide whether this is a frame are looked at: 57,000 bytes a second.
static void take_byte(uint8_t byte) {
    const uint8_t count = (uint8_t)(inject.count + 1u);
    inject.frame[inject.count] = byte;
    inject.count = count;
    if (count == INJECT_FRAME) {
        if (intact()) {
            take_frame();
            inject.count = 0;
        } else {
            resynchronise();
        }
    } else if ((count == 1u || count == LENGTH_AT + 1u) && !begins_frame()) {
        resynchronise();
    }
}

void inject_decode(void) {
    uint8_t byte = 0;
    while (ring_pop_byte(&inject.received, &byte)) {
        take_byte(byte);
    }
}

// --- ticks ---

static uint16_t sample(const InjectInputs *in, uint8_t index) {
    const uint8_t bit = (uint8_t)(10u * index);
    const uint16_t shifted = (uint16_t)(half(&in->packed[bit / 8u]) >> (bit % 8u));
    return shifted & 0x3FFu;
}

static void give_command(App *app, uint32_t tick) {
    if (!inject.command_waits || inject.command_tick > tick) {
        return;
    }
    inject.command_waits = false;
    for (uint8_t k = 0; k < INJECT_FRAME; k++) {
        app_on_received(app, inject.command[k], false);
    }
}

// Hands the inputs of a tick over as the interrupts of the chip do.
static void give_inputs(App *app, const InjectInputs *in) {
    const uint16_t tick_before = (uint16_t)((in->tick - 1u) * HAL_CYCLES_PER_TICK);
    for (uint8_t k = 0; k < in->edge_count; k++) {
        app_on_edge(app, (uint16_t)(tick_before + in->edge_cycle[k]));
    }
    for (uint8_t k = 0; k < in->sample_count; k++) {
        (void)app_next_channel(app);
        app_on_sample(app, sample(in, k));
    }
    inject.switches = in->switches;
}

bool inject_has_room(void) {
    const uint8_t queued = (uint8_t)(inject.send_head - inject.send_tail);
    return queued <= INJECT_SEND_BYTES - TICK_BYTES_MAX;
}

static void push(uint8_t byte) {
    const uint8_t head = inject.send_head;
    inject.send[head % INJECT_SEND_BYTES] = byte;
    inject.send_head = (uint8_t)(head + 1u);
}

// Queues the answer of a tick, unless the queue is full: the host then asks for it again.
static void queue_drive(uint8_t turn) {
    inject.hello = 0;
    if (!inject_has_room()) {
        return;
    }
    for (uint8_t k = 0; k < INJECT_FRAME; k++) {
        push(inject.drive[turn][k]);
    }
    hal_uart_wake();
}

static void queue_telemetry(App *app) {
    uint8_t byte = 0;
    while (app_on_ready(app, &byte)) {
        push(byte);
    }
}

// DRIVE: flags, signed compare value, dead time, timer ticks, count within the tick, low byte of
// the tick number.
static void send_drive(uint8_t clock_count) {
    const uint8_t between = (uint8_t)(inject.low_above - inject.high_below);
    const int16_t leg_a = (int16_t)(inject.high_below + between / 2u);
    const int16_t compare = inject.leg_b_high ? (int16_t)(leg_a - HAL_COMPARE_MAX) : leg_a;
    const uint16_t shown = (uint16_t)(inject.enabled ? compare : 0);
    const uint8_t turn = (uint8_t)inject.done & 1u;
    uint8_t *frame = inject.drive[turn];
    uint8_t *data = &frame[DATA_AT];
    frame[0] = FRAME_START;
    put_word(&frame[TICK_AT], inject.done);
    frame[LENGTH_AT] = DATA_BYTES;
    put_word(&frame[ID_AT], INJECT_ID_DRIVE);
    data[0] =
        (uint8_t)((inject.enabled ? 0u : INJECT_COAST) | (inject.apply_later ? INJECT_LATER : 0u) |
                  (inject.missing >= INJECT_SAFE_TICKS ? INJECT_SAFE : 0u) |
                  (inject.runs ? 0u : INJECT_IDLE));
    data[1] = (uint8_t)shown;
    data[2] = (uint8_t)(shown >> 8);
    data[3] = inject.enabled ? between : 0u;
    data[4] = inject.clock_ticks;
    data[5] = clock_count;
    data[6] = (uint8_t)inject.done;
    frame[CRC_AT] = crc_of(frame);
    frame[END_AT] = FRAME_END;
    queue_drive(turn);
}

static void restart(App *app, uint32_t build_hash) {
    inject.runs = true;
    inject.restarts = false;
    inject.done = 0;
    inject.latest = 0;
    inject.missing = 0;
    inject.command_waits = false;
    inject.inputs[0] = (InjectInputs){0};
    inject.inputs[1] = (InjectInputs){0};
    hal_bridge_open();
    app_init(app, build_hash);
}

static void execute(App *app, const InjectInputs *in, uint8_t clock_count) {
    const uint8_t late = inject.missing >= INJECT_SAFE_TICKS ? inject.missing : 0u;
    give_command(app, in->tick);
    give_inputs(app, in);
    app_on_tick(app);
    app_tick(app, late);
    app_on_apply(app);
    inject.done = in->tick;
    inject.missing = 0;
    send_drive(clock_count);
    queue_telemetry(app);
}

static void count_missing(uint8_t clock_count) {
    if (inject.done > 0u && inject.missing < UINT8_MAX) {
        inject.missing++;
    }
    inject.hello = (uint8_t)(inject.hello + (inject.hello < UINT8_MAX ? 1u : 0u));
    const bool safe = inject.missing == INJECT_SAFE_TICKS;
    if (safe) {
        hal_bridge_cut();
    }
    if (safe || inject.hello >= INJECT_HELLO_TICKS) {
        send_drive(clock_count);
    } else if (inject.repeats) {
        queue_drive((uint8_t)inject.repeat_tick & 1u);
    }
    inject.repeats = false;
}

void inject_init(App *app, uint32_t build_hash) {
    inject = (Inject){0};
    hal_bridge_open();
    app_init(app, build_hash);
}

void inject_timer_tick(App *app, uint32_t build_hash, uint8_t clock_count) {
    inject.clock_ticks++;
    if (inject.restarts) {
        restart(app, build_hash);
        send_drive(clock_count);
        return;
    }
    const InjectInputs *in = &inject.inputs[(uint8_t)(inject.done + 1u) & 1u];
    if (inject.runs && in->tick == inject.done + 1u && complete(in)) {
        execute(app, in, clock_count);
    } else {
        count_missing(clock_count);
    }
}
