# Writes build_hash.h: the first 24 bits of the commit's hash, 0 outside git. The file is touched
# only when the hash has changed.
cmake_minimum_required(VERSION 3.25)  # sets the policies, which a script does not inherit
execute_process(COMMAND git -C ${SOURCE} rev-parse --short=6 HEAD
  OUTPUT_VARIABLE hash OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
if(failed OR NOT hash MATCHES "^[0-9a-f]+$")
  set(hash 0)
endif()
string(SUBSTRING "${hash}" 0 6 hash)
file(CONFIGURE OUTPUT ${OUTPUT} @ONLY
  CONTENT "// Which commit this is built from.\n#define VGROOVE_BUILD_HASH 0x@hash@u\n")
