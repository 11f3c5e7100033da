// Single-producer, single-consumer rings, see ring.h.
#include "core/ring.h"

bool ring_push_word(RingWords *self, uint16_t item) {
    const uint8_t head = self->head;
    if ((uint8_t)(head - self->tail) >= RING_WORDS) {
        return false;
    }
    self->low[head % RING_WORDS] = (uint8_t)item;
    self->high[head % RING_WORDS] = (uint8_t)(item >> 8);
    self->head = (uint8_t)(head + 1u);
    return true;
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
    if ((uint8_t)(head - self->tail) >= RING_BYTES) {
        return false;
    }
    self->items[head % RING_BYTES] = item;
    self->head = (uint8_t)(head + 1u);
    return true;
}

bool ring_pop_byte(RingBytes *self, uint8_t *item) {
    const uint8_t tail = self->tail;
    if (tail == self->head) {
        return false;
    }
    *item = self->items[tail % RING_BYTES];
    self->tail = (uint8_t)(tail + 1u);
    return true;
}
