// The list of the controllers, the only place that names them: a new controller is an entry here.
//
// CONTROL_LIST(X): X(MODE, name, Type, directions, reversed, blows, heavy, setpoints...)
//   MODE        value of `mode` in telemetry/vgroove.dbc in upper case: TELEMETRY_MODE_<MODE>
//   name, Type  name_start(), name_step(), ..., structs Type and TypeSetpoints (controller.h)
//   directions  CONTROL_BOTH, or CONTROL_FORWARD: the plain mode drives in reverse
//   reversed    function that adapts the setpoints to a drive in reverse, or CONTROL_UNCHANGED
//   blows       where the blow detector (blow.h) finds the blows, CONTROL_BLOWS_*
//   heavy       function of the state: whether the last step used so many cycles that the tick
//               has no room for a slow telemetry frame; CONTROL_LIGHT: never
//   setpoints   the parameter of each member of TypeSetpoints, in the order of the members
//
// CONTROL_LIST is the list of this build, CONTROL_LIST_ALL that of all builds. VGROOVE_TOOL is the
// sum of the CONTROL_TOOL_* whose controllers are compiled in. CMake and PlatformIO set it
// (docs/firmware.md, "A build per tool"); without it all controllers are compiled in.
//
// Steps of a new controller:
//   1. telemetry/vgroove.dbc: its name in the value table of `mode`; app/param_table.h: its
//      parameters; then run telemetry/generate.py.
//   2. controllers/name.h and .c: its functions, as controllers/controller.h says.
//   3. Here: the include of its header and its entry in the list of its tool.
#ifndef VGROOVE_APP_CONTROL_LIST_H
#define VGROOVE_APP_CONTROL_LIST_H

#include "app/param_store.h"
#include "controllers/drill.h"
#include "controllers/screwing.h"
#include "controllers/sync.h"
#include "controllers/torque.h"
#include "controllers/vibration.h"

#define CONTROL_TOOL_IMPACT 1
#define CONTROL_TOOL_DRILL 2
#ifndef VGROOVE_TOOL
#define VGROOVE_TOOL (CONTROL_TOOL_IMPACT + CONTROL_TOOL_DRILL)
#endif

enum {
    CONTROL_BOTH,
    CONTROL_FORWARD,  // acts in the direction that tightens
};

enum {
    CONTROL_BLOWS_NONE,          // the detector does not run
    CONTROL_BLOWS_BY_PARAMETER,  // in the signal of parameter blow_source
    CONTROL_BLOWS_BY_METHOD,     // in the signal of the first setpoint, CONTROLLER_METHOD_*
};

#define CONTROL_UNCHANGED(set) ((void)(set))
#define CONTROL_LIGHT(state) false

// clang-format off
#define CONTROL_LIST_IMPACT(X)                                                                    \
    X(SYNC, sync, Sync, CONTROL_BOTH, CONTROL_UNCHANGED, CONTROL_BLOWS_BY_METHOD, CONTROL_LIGHT,  \
      PARAM_SYNC_METHOD, PARAM_SYNC_LOW_MV, PARAM_SYNC_HIGH_MV, PARAM_SYNC_DEPTH_MIN_Q15,         \
      PARAM_SYNC_DEPTH_MAX_Q15, PARAM_SYNC_CURRENT_A_Q9)                                          \
    X(SCREWING, screwing, Screwing, CONTROL_FORWARD, CONTROL_UNCHANGED,                           \
      CONTROL_BLOWS_BY_PARAMETER, CONTROL_LIGHT,                                                  \
      PARAM_HALL_PULSES, PARAM_BLOW_TURN_Q8, PARAM_SCREWING_SHARE_Q15, PARAM_SCREWING_LEAST_MV,   \
      PARAM_SCREWING_SMALL_DEG_Q4, PARAM_SCREWING_RISE_Q8)                                        \
    X(VIBRATION, vibration, Vibration, CONTROL_BOTH, CONTROL_UNCHANGED,                           \
      CONTROL_BLOWS_BY_PARAMETER, CONTROL_LIGHT,                                                  \
      PARAM_VIBRATION_METHOD, PARAM_VIBRATION_APPROACH_Q15, PARAM_VIBRATION_CLIMB_Q15,            \
      PARAM_VIBRATION_CLIMB_PER_MS_Q15, PARAM_VIBRATION_CLIMB_TURN_Q8,                            \
      PARAM_VIBRATION_SURGE_A_Q9, PARAM_VIBRATION_HARD_SHARE_Q15, PARAM_VIBRATION_HARD_MV,        \
      PARAM_MOTOR_MOHM, PARAM_MOTOR_RPM_PER_V)                                                    \
    X(TORQUE, torque, Torque, CONTROL_FORWARD, CONTROL_UNCHANGED, CONTROL_BLOWS_BY_PARAMETER,     \
      torque_was_heavy,                                                                        \
      PARAM_TORQUE_TARGET_NM)

#define CONTROL_LIST_DRILL(X)                                                                     \
    X(DRILL, drill, Drill, CONTROL_BOTH, drill_reverse, CONTROL_BLOWS_NONE, CONTROL_LIGHT,        \
      PARAM_DRILL_CLUTCH_DNM, PARAM_DRILL_RATIO_Q8, PARAM_MOTOR_MOHM, PARAM_MOTOR_RPM_PER_V,      \
      PARAM_DRILL_PULSE, PARAM_DRILL_KICKBACK)
// clang-format on

#define CONTROL_LIST_ALL(X) CONTROL_LIST_IMPACT(X) CONTROL_LIST_DRILL(X)

#if VGROOVE_TOOL == CONTROL_TOOL_IMPACT
#define CONTROL_LIST(X) CONTROL_LIST_IMPACT(X)
#elif VGROOVE_TOOL == CONTROL_TOOL_DRILL
#define CONTROL_LIST(X) CONTROL_LIST_DRILL(X)
#elif VGROOVE_TOOL == CONTROL_TOOL_IMPACT + CONTROL_TOOL_DRILL
#define CONTROL_LIST(X) CONTROL_LIST_ALL(X)
#else
#error "VGROOVE_TOOL is 1 (impact), 2 (drill) or 3 (both)"
#endif

#endif
