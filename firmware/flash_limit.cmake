# Refuses an ELF whose code and initial values exceed LIMIT bytes of flash.
cmake_minimum_required(VERSION 3.25)  # sets the policies, which a script does not inherit
execute_process(COMMAND avr-size -A ${ELF} OUTPUT_VARIABLE sections COMMAND_ERROR_IS_FATAL ANY)
set(bytes 0)
foreach(section text data)
  if(sections MATCHES "\\.${section} +([0-9]+)")
    math(EXPR bytes "${bytes} + ${CMAKE_MATCH_1}")
  endif()
endforeach()
if(bytes GREATER LIMIT)
  message(FATAL_ERROR "VGROOVE_TOOL=${TOOL} takes ${bytes} bytes of flash on the ${MCU}, "
    "${LIMIT} are allowed: choose VGROOVE_TOOL=impact or drill, or the ATmega2560.")
endif()
