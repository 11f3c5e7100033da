// The rooms that are bound into vgroove._core, each in its own source file.
#ifndef VGROOVE_HIL_BINDINGS_HPP
#define VGROOVE_HIL_BINDINGS_HPP

#include <nanobind/nanobind.h>

void bind_plant(nanobind::module_ &m);
void bind_drill(nanobind::module_ &m);     // bind_drill.cpp
void bind_firmware(nanobind::module_ &m);  // bind_firmware.cpp

#endif
