// Lock-free queues between an interrupt and the tick: one side pushes, the other pops, and indices
// are single bytes.
#ifndef VGROOVE_CORE_RING_H
#define VGROOVE_CORE_RING_H

#include <stdbool.h>
#include <stdint.h>

#define RING_WORDS 32u                     // edge times of four ticks
#define RING_BYTES_BIT 6u                  // set in the index behind the last one
#define RING_BYTES (1u << RING_BYTES_BIT)  // UART: three commands

typedef struct {
    volatile uint8_t head;             // pushes so far, modulo 256
    volatile uint8_t tail;             // pops so far
    volatile uint8_t low[RING_WORDS];  // low and high bytes apart: fewer cycles on the AVR
    volatile uint8_t high[RING_WORDS];
} RingWords;

typedef struct {
    volatile uint8_t items[RING_BYTES];  // one of them stays free
    volatile uint8_t head;               // index of the next push
    volatile uint8_t tail;               // index of the next pop
} RingBytes;

// Frames of equal length in fixed slots: built in place, never wrapped around. Indices run from
// RING_FRAMES_FIRST to 255: an increment at the end of `items` overflows to 0.
#define RING_FRAME 19u
#define RING_FRAMES_BYTES (4u * RING_FRAME)
#define RING_FRAMES_FIRST (256u - RING_FRAMES_BYTES)

typedef struct {
    volatile uint8_t head;  // index of the next frame
    volatile uint8_t tail;  // index of the next byte to send
    uint8_t items[RING_FRAMES_BYTES];
} RingFrames;

void ring_clear_frames(RingFrames *self);

// Number of whole frames that fit, at most 3.
uint8_t ring_frames_free(const RingFrames *self);

// Slot of the next frame (`ahead` = 0) or of the one after it (1).
uint8_t *ring_frame_at(RingFrames *self, uint8_t ahead);

// Queues `count` frames that have been built in their slots.
void ring_push_frames(RingFrames *self, uint8_t count);
bool ring_pop_frame_byte(RingFrames *self, uint8_t *item);

// Return false when full; the item is dropped.
bool ring_push_word(RingWords *self, uint16_t item);
bool ring_push_pair(RingWords *self, uint8_t low, uint8_t high);  // the same word by its bytes
bool ring_push_byte(RingBytes *self, uint8_t item);

// False when empty; `*item` is then unchanged.
bool ring_pop_byte(RingBytes *self, uint8_t *item);

uint8_t ring_count_words(const RingWords *self);

// Oldest word; the ring must not be empty.
uint16_t ring_peek_word(const RingWords *self);
void ring_drop_word(RingWords *self);

#endif
