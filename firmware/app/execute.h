// Commands from the host.
#ifndef VGROOVE_APP_EXECUTE_H
#define VGROOVE_APP_EXECUTE_H

#include "app/app.h"

// Takes what has been received; executes and acknowledges at most one command a tick.
void execute_received(App *app);

// Parameters have changed: their drivers take them over in the ticks that follow, a few at a time, since each costs divisions.
void execute_parameters(App *app);
void execute_parameters_step(App *app);
bool execute_parameters_pending(const App *app);

#endif
