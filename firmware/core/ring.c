// Single-producer, single-consumer rings, see ring.h.
#include "core/ring.h"

bool ring_push_pair(RingWords *self, uint8_t low, uint8_t high) {
    const uint8_t head = self->head;
    if (head == (uint8_t)(self->tail + RING_WORDS)) {
        return false;
    }
    self->low[head % RING_WORDS] = low;
    self->high[head % RING_WORDS] = high;
    self->head = (uint8_t)(head + 1u);
    return true;
}

bool ring_push_word(RingWords *self, uint16_t item) {
    return ring_push_pair(self, (uint8_t)item, (uint8_t)(item >> 8));
}

uint8_t ring_count_words(const RingWords *self) {
    return (uint8_t)(self->head - self->tail);
}

uint16_t ring_peek_word(const RingWords *self) {
    const uint8_t at = self->tail % RING_WORDS;
    return (uint16_t)(self->low[at] | (uint16_t)((uint16_t)self->high[at] << 8));
}

void ring_drop_word(RingWords *self) {
    self->tail = (uint8_t)(self->tail + 1u);
}

bool ring_push_byte(RingBytes *self, uint8_t item) {
    const uint8_t head = self->head;
    const uint8_t next = (uint8_t)(head + 1u) % RING_BYTES;
    if (next == self->tail) {
        return false;
    }
    self->items[head] = item;
    self->head = next;
    return true;
}

bool ring_pop_byte(RingBytes *self, uint8_t *item) {
    const uint8_t tail = self->tail;
    if (tail == self->head) {
        return false;
    }
    *item = self->items[tail];
    self->tail = (uint8_t)(tail + 1u) % RING_BYTES;
    return true;
}

void ring_clear_frames(RingFrames *self) {
    self->head = RING_FRAMES_FIRST;
    self->tail = RING_FRAMES_FIRST;
}

uint8_t ring_frames_free(const RingFrames *self) {
    const uint8_t head = self->head;
    const uint8_t tail = self->tail;
    uint8_t used = (uint8_t)(head - tail);
    if (head < tail) {
        used = (uint8_t)(used + RING_FRAMES_BYTES);
    }
    if (used < RING_FRAME) {
        return 3;  // head must not reach tail
    }
    if (used < 2u * RING_FRAME) {
        return 2;
    }
    return used < 3u * RING_FRAME ? 1 : 0;
}

// Index `step` bytes further.
static uint8_t frames_after(uint8_t at, uint8_t step) {
    const uint8_t next = (uint8_t)(at + step);
    return (uint8_t)(next == 0u ? RING_FRAMES_FIRST : next);
}

uint8_t *ring_frame_at(RingFrames *self, uint8_t ahead) {
    const uint8_t head = self->head;
    const uint8_t at = ahead == 0u ? head : frames_after(head, RING_FRAME);
    return &self->items[at - RING_FRAMES_FIRST];
}

void ring_push_frames(RingFrames *self, uint8_t count) {
    uint8_t head = self->head;
    for (; count > 0u; count--) {
        head = frames_after(head, RING_FRAME);
    }
    __asm__ volatile("" : : : "memory");  // write the frames before head
    self->head = head;
}

bool ring_pop_frame_byte(RingFrames *self, uint8_t *item) {
    const uint8_t tail = self->tail;
    if (tail == self->head) {
        return false;
    }
    *item = self->items[tail - RING_FRAMES_FIRST];
    self->tail = frames_after(tail, 1);
    return true;
}
