"""PlatformIO pre-build step: writes build_hash.h with the first 24 bits of the commit's hash, 0
outside git.
"""

import re
import subprocess
from pathlib import Path

Import("env")  # noqa: F821  given by PlatformIO's SCons

found = subprocess.run(
    ["git", "rev-parse", "--short=6", "HEAD"], capture_output=True, text=True, check=False
)
commit = found.stdout.strip()[:6] if found.returncode == 0 else "0"
folder = Path(env.subst("$BUILD_DIR")) / "generated"  # noqa: F821
folder.mkdir(parents=True, exist_ok=True)
header = folder / "build_hash.h"
digits = commit if re.fullmatch("[0-9a-f]+", commit) else "0"
text = f"// Which commit this is built from.\n#define VGROOVE_BUILD_HASH 0x{digits}u\n"
if not header.exists() or header.read_text() != text:
    header.write_text(text)
env.Append(CPPPATH=[str(folder)])  # noqa: F821
