// Commands that concern parameters: PARAM_READ, PARAM_WRITE, DUMP.
#ifndef VGROOVE_APP_PARAM_COMMAND_H
#define VGROOVE_APP_PARAM_COMMAND_H

#include <stdbool.h>
#include <stdint.h>

#include "app/param_store.h"
#include "telemetry/command.h"
#include "telemetry/telemetry.h"

// Executes a new command and returns its result for the ACK: TELEMETRY_ACK_RESULT_UNKNOWN_ID for
// any other command. `idle`: the tool is not driven; otherwise PARAM_WRITE is refused.
uint8_t param_command(ParamStore *store, Telemetry *telemetry, const Command *command, bool idle);

// Telemetry's view of the parameters.
TelemetryParams param_report(const ParamStore *store);

#endif
