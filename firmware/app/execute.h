// Commands from the host.
#ifndef VGROOVE_APP_EXECUTE_H
#define VGROOVE_APP_EXECUTE_H

#include "app/app.h"

// Something has been received and is not held back by the ACK of the command before it.
bool execute_pending(const App *app);

// One step with that: some bytes, or a command checked, or executed and acknowledged, or the begin
// of a frame looked for in a damaged one.
void execute_received(App *app);

// Trigger released and shaft at rest.
bool execute_mode_may_change(const App *app);

#endif
