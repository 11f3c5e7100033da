// Telemetry of a tick: fills the frames from the state of the firmware.
#ifndef VGROOVE_APP_REPORT_H
#define VGROOVE_APP_REPORT_H

#include "app/app.h"

void report_start(App *app, uint32_t build_hash);
void report_tick(App *app);

#endif
