// Declarations shared by the files of the AVR layer.
#ifndef VGROOVE_HAL_AVR_AVR_H
#define VGROOVE_HAL_AVR_AVR_H

#include <stdint.h>

#include "app/app.h"

extern App avr_app;
extern volatile uint8_t avr_ticks_waiting;
extern uint8_t avr_reset_cause;

void avr_start_pins(void);

// Searches the lowest byte that the stack has used, a few bytes after each tick.
void avr_look_at_stack(void);

// Starts ADC and timers with interrupts off, before the main loop.
void avr_start_timers(void);

#endif
