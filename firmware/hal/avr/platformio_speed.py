"""PlatformIO pre-build step: compiles each source with the option that firmware/avr.cmake sets for
it.
"""

import re
from pathlib import Path

Import("env")  # noqa: F821  given by PlatformIO's SCons

cmake = (Path(env.subst("$PROJECT_DIR")) / "firmware" / "avr.cmake").read_text()  # noqa: F821
listed = re.findall(
    r"set_source_files_properties\(([^)]*?)\s+PROPERTIES COMPILE_OPTIONS ([^)\s]+)\)", cmake
)
options = {name: option for names, option in listed for name in names.split()}


def as_listed(env, node):  # noqa: ANN001, ANN201  SCons' objects
    """Object of a source, compiled with its listed option after all other flags."""
    path = node.get_path().replace("\\", "/")
    option = next((option for name, option in options.items() if path.endswith("/" + name)), None)
    return env.Object(node, CCFLAGS=[*env["CCFLAGS"], option]) if option else node


env.AddBuildMiddleware(as_listed, "*.c")  # noqa: F821
