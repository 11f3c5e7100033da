// Applies changed parameters to the drivers that use them, a few in each tick, since each needs a
// division.
#ifndef VGROOVE_APP_CONFIGURE_H
#define VGROOVE_APP_CONFIGURE_H

#include "app/app.h"

// The parameters have changed: starts from the first step.
void configure_begin(App *app);

// Whether steps are left; then configure_step() does the next one.
bool configure_pending(const App *app);
void configure_step(App *app);

#endif
