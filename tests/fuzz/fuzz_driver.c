// Runs the fuzz target without libFuzzer: fuzz_parsers SECONDS SEED. Inputs are random bytes, valid
// frames of known ids, and these with changed, lost, inserted and repeated bytes; prints their
// number.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "core/crc.h"

#define INPUT_MAX 400u
#define FRAME 19u

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static uint64_t state;

// xorshift64*
static uint32_t drawn(uint32_t below) {
    state ^= state >> 12;
    state ^= state << 25;
    state ^= state >> 27;
    return (uint32_t)((state * 2685821657736338717u) >> 33) % below;
}

static uint16_t any_id(void) {
    static const uint16_t ids[] = {128, 129, 130, 131, 256, 512, 513, 514, 515, 516, 517, 518};
    return ids[drawn(sizeof ids / sizeof *ids)];
}

static void make_frame(uint8_t frame[FRAME], uint16_t id, uint8_t tick) {
    memset(frame, 0, FRAME);
    frame[0] = 0xAA;
    frame[1] = tick;
    frame[5] = 8;
    frame[6] = (uint8_t)id;
    frame[7] = (uint8_t)(id >> 8);
    for (uint32_t k = 10; k < 17; k++) {
        frame[k] = (uint8_t)drawn(256);
    }
    if (id <= 129) {
        const uint32_t most = drawn(8) == 0 ? 256 : id == 128 ? 9 : 4;
        frame[15] = (uint8_t)(id == 128 ? drawn(most) << 4 : drawn(most));
    }
    frame[17] =
        (uint8_t)(crc8_over_frame(crc8_over(CRC8_INIT, &frame[6], 4), &frame[1], &frame[10]) ^
                  CRC8_FINAL_XOR);
    frame[18] = 0xBB;
}

static size_t make_input(uint8_t *data) {
    size_t size = 0;
    data[size++] = (uint8_t)drawn(256);
    uint8_t tick = 0, sense = 0;
    while (size + FRAME < INPUT_MAX && drawn(20) != 0) {
        if (drawn(4) == 0) {
            data[size++] = (uint8_t)(drawn(2) == 0 ? 0xAA : drawn(256));
            continue;
        }
        // inputs of a tick in their order, or any frame
        const uint16_t part = (uint16_t)(128u + sense);
        make_frame(&data[size], drawn(4) == 0 ? any_id() : part, tick);
        sense = (uint8_t)((sense + 1u) % 3u);
        tick = (uint8_t)(tick + (sense == 0u ? 1 : 0));
        size += FRAME - (drawn(10) == 0 ? drawn(FRAME) : 0);
    }
    for (uint32_t k = drawn(4); k > 0; k--) {
        data[drawn((uint32_t)size)] ^= (uint8_t)(1u << drawn(8));
    }
    return size;
}

int main(int count, char **arguments) {
    const double seconds = count > 1 ? atof(arguments[1]) : 5.0;
    state = count > 2 ? strtoull(arguments[2], NULL, 10) * 2 + 1 : 1;
    const clock_t end = clock() + (clock_t)(seconds * CLOCKS_PER_SEC);
    unsigned long inputs = 0;
    uint8_t data[INPUT_MAX];
    for (; clock() < end; inputs++) {
        (void)LLVMFuzzerTestOneInput(data, make_input(data));
    }
    (void)printf("%lu inputs\n", inputs);
    return 0;
}
