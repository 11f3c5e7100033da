"""PlatformIO pre-build step: passes the options of code generation to the linker as well, which
generates the code of a link-time optimisation; PlatformIO gives it only those that begin with -Wl.
"""

import re

Import("env")  # noqa: F821  given by PlatformIO's SCons

flags = " ".join(env["BUILD_FLAGS"]).split()  # noqa: F821
env.Append(LINKFLAGS=[flag for flag in flags if re.match("-[fmO]", flag)])  # noqa: F821
