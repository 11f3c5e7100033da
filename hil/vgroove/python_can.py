"""python-can without asammdf, which only its MF4 files need: with pandas it takes longer to import
than all the rest of a command.
"""

import importlib
import sys
from types import ModuleType


class _WithoutAsammdf:
    """Import hook that reports asammdf as not installed while python-can is being imported."""

    def find_spec(self, name: str, path: object, target: object = None) -> None:
        can = sys.modules.get("can")
        if name == "asammdf" and can is not None and not hasattr(can, "MF4Reader"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def import_without_asammdf() -> None:
    """Make python-can importable without loading asammdf, for the rest of the process. Only a main
    program may call it: python-can's own readers and writers of MF4 files are then missing, and
    mf4_files() has to be used.
    """
    sys.meta_path.insert(0, _WithoutAsammdf())


def mf4_files() -> ModuleType:
    """The module can.io.mf4, imported again with asammdf where it was imported without."""
    from can.io import mf4

    return importlib.reload(mf4) if mf4.asammdf is None else mf4
