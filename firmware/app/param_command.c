// Parameter commands, see param_command.h.
#include "app/param_command.h"

static uint8_t write_command(ParamStore *store, const Command *command, bool idle) {
    TelemetryParamWrite write;
    (void)telemetry_unpack_param_write(&write, command->data);
    if (write.write_index >= PARAM_COUNT) {
        return TELEMETRY_ACK_RESULT_UNKNOWN_INDEX;
    }
    if (!idle) {
        return TELEMETRY_ACK_RESULT_NOT_NOW;
    }
    const bool taken = param_set(store, (ParamIndex)write.write_index, write.write_value);
    return taken ? TELEMETRY_ACK_RESULT_OK : TELEMETRY_ACK_RESULT_OUT_OF_RANGE;
}

static uint8_t read_command(Telemetry *telemetry, const Command *command) {
    TelemetryParamRead read;
    (void)telemetry_unpack_param_read(&read, command->data);
    if (read.read_index >= PARAM_COUNT) {
        return TELEMETRY_ACK_RESULT_UNKNOWN_INDEX;
    }
    telemetry_read(telemetry, read.read_index);
    return TELEMETRY_ACK_RESULT_OK;
}

uint8_t param_command(ParamStore *store, Telemetry *telemetry, const Command *command, bool idle) {
    if (command->id == TELEMETRY_PARAM_WRITE_ID) {
        return write_command(store, command, idle);
    }
    if (command->id == TELEMETRY_PARAM_READ_ID) {
        return read_command(telemetry, command);
    }
    if (command->id == TELEMETRY_DUMP_ID) {
        telemetry_dump(telemetry);
        return TELEMETRY_ACK_RESULT_OK;
    }
    return TELEMETRY_ACK_RESULT_UNKNOWN_ID;
}

TelemetryParams param_report(const ParamStore *store) {
    return (TelemetryParams){
        .value = store->value,
        .count = PARAM_COUNT,
        .table = {.table_version = PARAM_VERSION,
                  .table_slot = store->slot,
                  .table_status = store->status},
    };
}
