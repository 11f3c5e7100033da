// vgroove._core: the plant and the native firmware as a Python module.
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
