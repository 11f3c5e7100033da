// Commands that concern parameters: PARAM_READ, PARAM_WRITE, DUMP.
#ifndef VGROOVE_APP_PARAM_COMMAND_H
#define VGROOVE_APP_PARAM_COMMAND_H

#include <stdbool.h>
#include <stdint.h>

#include "app/param_store.h"
#include "telemetry/command.h"
#include "telemetry/telemetry.h"

// Executes a fresh command and returns its result for the ACK, TELEMETRY_ACK_RESULT_UNKNOWN_ID for
// a command that is not one of the three. `idle`: the tool is not driven; PARAM_WRITE is refused
// otherwise.
uint8_t param_command(ParamStore *store, Telemetry *telemetry, const Command *command, bool idle);

// What telemetry reports of the parameters.
TelemetryParams param_report(const ParamStore *store);

#endif
