// Commands from the host.
#ifndef VGROOVE_APP_EXECUTE_H
#define VGROOVE_APP_EXECUTE_H

#include "app/app.h"

// Takes what has been received; executes and acknowledges at most one command a tick.
void execute_received(App *app);

// Hands the parameters to the drivers that take them at once.
void execute_parameters(App *app);

#endif
