// State machine of the tool.
//
//                 offset known, trigger calibrated, or cancelled
//   CALIBRATE <-----------------------------------------------> IDLE <------------------- FAULT
//                 asked for at standstill                        | ^    released, no        ^
//                                       pressed, armed, at rest  | |    condition left      | any
//                                       fault,
//                                                                v | at rest                | from
//                                                                everywhere
//                                                   +-------> DRIVE|---> STOPPED            |
//                                    pressed, armed |            | |       (contact open: IDLE)
//                                                   |  released, | |
//                                                   | other way  v |
//                                                   +--------- RELEASE
//
// STOPPED: the controller has ended the drive; open until the contact opens.
// armed: the contact was seen open since the start, the last fault, the last stop and the last
// change of direction. The direction follows its switch at standstill in IDLE only.
#ifndef VGROOVE_APP_MODES_H
#define VGROOVE_APP_MODES_H

#include <stdbool.h>
#include <stdint.h>

typedef enum {
    MODES_IDLE,
    MODES_DRIVE,
    MODES_RELEASE,
    MODES_FAULT,
    MODES_CALIBRATE,
    MODES_STOPPED,
} ModesState;

typedef struct {
    bool pressed;  // contact closed and travel beyond the dead band
    bool contact;  // contact closed
    bool reverse_switch;
    bool standstill;
    bool fault;           // one is latched
    bool fault_persists;  // its condition holds still
    bool calibrating;     // asked for and not finished
    bool stopped;         // the controller has ended the drive
} ModesInputs;

typedef struct {
    uint8_t state;  // ModesState
    bool reverse;
    bool armed;
} Modes;

typedef enum {
    MODES_COMMAND_COAST,
    MODES_COMMAND_DRIVE,
    MODES_COMMAND_RAMP_DOWN,
} ModesCommand;

void modes_init(Modes *self);
ModesState modes_next(const Modes *self, const ModesInputs *m);
ModesCommand modes_output(const Modes *self, bool release_ramps);
void modes_step(Modes *self, const ModesInputs *m);

#endif
