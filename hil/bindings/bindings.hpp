// The rooms that are bound into vgroove._core, each in its own source file.
#ifndef VGROOVE_HIL_BINDINGS_HPP
#define VGROOVE_HIL_BINDINGS_HPP

#include <nanobind/nanobind.h>

#include <string>

#include "plant/loads.hpp"

vgroove::LoadKind load_kind(const std::string &kind);  // bind_plant.cpp
void bind_plant(nanobind::module_ &m);
void bind_drill(nanobind::module_ &m);     // bind_drill.cpp
void bind_joints(nanobind::module_ &m);    // bind_joints.cpp
void bind_impact(nanobind::module_ &m);    // bind_impact.cpp, called by bind_plant
void bind_firmware(nanobind::module_ &m);  // bind_firmware.cpp
void bind_lockstep(nanobind::module_ &m);  // bind_lockstep.cpp: both of them

#endif
