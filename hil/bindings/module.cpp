// vgroove._core: what Python sees of the plant and of the native firmware; one bind_ function a
// room.
#include <nanobind/nanobind.h>

#include "bindings.hpp"

NB_MODULE(_core, m) {
    m.doc() = "Plant and native firmware of vgroove.";
    bind_plant(m);
    bind_drill(m);
    bind_joints(m);
#ifdef VGROOVE_WITH_FIRMWARE
    bind_firmware(m);
    bind_lockstep(m);
#endif
}
