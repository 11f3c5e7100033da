# The ELF for VGROOVE_MCU in the root of the build tree, its hex file beside it, and the program of
# the golden vectors.
set(VGROOVE_MCU atmega328p CACHE STRING "atmega328p or atmega2560")
# Whose controllers are compiled in (firmware/app/control_list.h): impact 1, drill 2, both 3.
if(VGROOVE_MCU STREQUAL "atmega2560")
  set(default_tool both)
else()
  set(default_tool impact)
endif()
set(VGROOVE_TOOL ${default_tool} CACHE STRING "impact, drill or both")
set(tools impact drill both)
list(FIND tools "${VGROOVE_TOOL}" tool_index)
if(tool_index EQUAL -1)
  message(FATAL_ERROR "VGROOVE_TOOL is impact, drill or both, not \"${VGROOVE_TOOL}\"")
endif()
math(EXPR tool_number "${tool_index} + 1")

# The build for real-time runs against a host that simulates the tool (docs/hil.md): sensors and
# gates are exchanged over the serial line, everything above hal.h is the same.
option(VGROOVE_INJECT "sensor counts and bridge commands over the serial line" OFF)

if(VGROOVE_MCU STREQUAL "atmega2560")  # slower calls than the 328P's, but flash to spare
  set(optimisation -O3 -fno-tree-loop-optimize -fno-ivopts)
else()
  set(optimisation -Os)
endif()
set(avr_flags -mmcu=${VGROOVE_MCU} -DF_CPU=16000000UL ${optimisation} -flto -ffunction-sections
  -fdata-sections -fno-fat-lto-objects -mrelax -mstrict-X -fno-move-loop-invariants)
set(VGROOVE_AVR_FLAGS ${avr_flags} PARENT_SCOPE)

# Sorted as PlatformIO does: the order of the objects changes the code of a link-time optimisation.
set(target_sources ${firmware_sources} hal/avr/bridge.c hal/avr/eeprom.c hal/avr/isr.c
  hal/avr/main.c hal/avr/runtime.c hal/avr/serial.c hal/avr/start.c)
if(VGROOVE_INJECT)
  set(target_sources ${firmware_sources} hal/avr/eeprom.c hal/avr/runtime.c hal/avr/start.c
    hal/inject/avr_main.c hal/inject/inject.c)
endif()
list(SORT target_sources)
add_executable(vgroove ${target_sources})
# Interrupts and fold-back are compiled for speed also on the Uno, whose other code is compiled for
# size; rarely executed code with fewer inlined functions, which makes it smaller.
set_source_files_properties(hal/avr/isr.c controllers/foldback.c drivers/adc_sequence.c core/ring.c
  PROPERTIES COMPILE_OPTIONS -O2)
set_source_files_properties(app/calibrate.c app/configure.c app/execute.c app/param_command.c
  app/param_store.c telemetry/command.c drivers/hall_spacing.c core/divide.c
  PROPERTIES COMPILE_OPTIONS -fno-inline-small-functions)
target_include_directories(vgroove PRIVATE ${CMAKE_CURRENT_SOURCE_DIR} ${build_hash_dir})
target_compile_options(vgroove PRIVATE ${avr_flags})
target_compile_definitions(vgroove PRIVATE VGROOVE_TOOL=${tool_number})
target_link_options(vgroove PRIVATE ${avr_flags} -Wl,--gc-sections -Wl,--sort-section=alignment
  -Wl,-Map=${CMAKE_BINARY_DIR}/vgroove.map)
target_link_libraries(vgroove PRIVATE vgroove_warnings)
set_target_properties(vgroove PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}
  SUFFIX .elf POSITION_INDEPENDENT_CODE OFF)
add_dependencies(vgroove vgroove_build_hash)
# Of the Uno's 32 KiB the boot loader takes 0.5 to 2, and 2 are reserve. On the Mega the tables in
# flash are read by 16-bit addresses.
if(VGROOVE_MCU STREQUAL "atmega2560")
  set(flash_limit 61440)
else()
  set(flash_limit 28672)
endif()
if(VGROOVE_INJECT AND VGROOVE_MCU STREQUAL "atmega328p")
  set(flash_limit 30720)  # no reserve: it is flashed for runs on the bench alone
endif()
set(VGROOVE_FLASH_LIMIT ${flash_limit} CACHE STRING "greatest number of flash bytes")
add_custom_command(TARGET vgroove POST_BUILD
  COMMAND ${CMAKE_COMMAND} -DELF=$<TARGET_FILE:vgroove> -DTOOL=${VGROOVE_TOOL}
          -DMCU=${VGROOVE_MCU} -DLIMIT=${VGROOVE_FLASH_LIMIT}
          -P ${CMAKE_CURRENT_SOURCE_DIR}/flash_limit.cmake
  COMMAND avr-objcopy -O ihex -R .eeprom -R .fuse -R .lock $<TARGET_FILE:vgroove>
          ${CMAKE_BINARY_DIR}/vgroove.hex
  BYPRODUCTS ${CMAKE_BINARY_DIR}/vgroove.hex)

# The golden vectors on the target: prints over the UART which of them fail.
set(vectors_dir ${PROJECT_SOURCE_DIR}/tests/vectors)
if(EXISTS ${vectors_dir}/vectors.c)
  add_executable(vectors ${PROJECT_SOURCE_DIR}/tests/avr/vectors_main.c ${vectors_dir}/vectors.c
    controllers/foldback.c core/divide.c core/fixed.c core/ring.c core/slew.c
    drivers/analog.c drivers/current_sense.c drivers/h_bridge.c drivers/hall_spacing.c
    drivers/hall_speed.c drivers/trigger.c hal/avr/bridge.c hal/avr/serial.c)
  target_include_directories(vectors PRIVATE ${CMAKE_CURRENT_SOURCE_DIR} ${vectors_dir})
  target_compile_options(vectors PRIVATE ${avr_flags})
  target_link_options(vectors PRIVATE ${avr_flags} -Wl,--gc-sections)
  target_link_libraries(vectors PRIVATE vgroove_warnings)
  set_target_properties(vectors PROPERTIES RUNTIME_OUTPUT_DIRECTORY ${CMAKE_BINARY_DIR}
    SUFFIX .elf POSITION_INDEPENDENT_CODE OFF)
endif()
