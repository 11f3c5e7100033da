// Executes the commands of the host.
#ifndef VGROOVE_APP_EXECUTE_H
#define VGROOVE_APP_EXECUTE_H

#include "app/app.h"

// Whether received bytes or a complete command are pending and no ACK is waiting to be sent.
bool execute_pending(const App *app);

// Whether the next step checks a command, searches a damaged one, or executes it; else it takes
// bytes.
bool execute_answers(const App *app);

// One step: takes some bytes, searches a damaged frame for the next start byte, checks a command,
// or executes and acknowledges it.
void execute_received(App *app);

// Whether the trigger is released and the shaft at rest.
bool execute_mode_may_change(const App *app);

#endif
