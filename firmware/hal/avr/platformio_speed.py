"""PlatformIO pre-build step: what firmware/avr.cmake compiles for speed is compiled so here, too."""

import re
from pathlib import Path

Import("env")  # noqa: F821  given by PlatformIO's SCons

cmake = (Path(env.subst("$PROJECT_DIR")) / "firmware" / "avr.cmake").read_text()  # noqa: F821
fast = re.search(r"set_source_files_properties\(([^)]*?) PROPERTIES COMPILE_OPTIONS -O2\)", cmake)[1].split()


def for_speed(env, node):  # noqa: ANN001, ANN201  SCons' objects
    """The object of a source, with -O2 after all other flags where it is listed."""
    if not any(node.get_path().replace("\\", "/").endswith(name) for name in fast):
        return node
    return env.Object(node, CCFLAGS=[*env["CCFLAGS"], "-O2"])


env.AddBuildMiddleware(for_speed, "*.c")  # noqa: F821
