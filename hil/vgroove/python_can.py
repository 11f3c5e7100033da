"""python-can without asammdf, which only its MF4 files need: with pandas it takes longer to import
than all the rest of a command.
"""

import importlib
import sys
from types import ModuleType


class _WithoutAsammdf:
    """Finds no asammdf while python-can is being imported."""

    def find_spec(self, name: str, path: object, target: object = None) -> None:
        can = sys.modules.get("can")
        if name == "asammdf" and can is not None and not hasattr(can, "MF4Reader"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def import_without_asammdf() -> None:
    """Later imports of python-can in this process, of which the caller is the main program, leave
    out asammdf.
    """
    sys.meta_path.insert(0, _WithoutAsammdf())


def mf4_files() -> ModuleType:
    """can.io.mf4 with its asammdf."""
    from can.io import mf4

    return importlib.reload(mf4) if mf4.asammdf is None else mf4
