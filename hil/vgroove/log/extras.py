"""Packages that only some formats need: the extra `formats` of the package."""

from importlib import import_module
from typing import Any

from vgroove.errors import VgrooveError


def need(module: str, what: str) -> Any:
    """The module; VgrooveError, which names the command that installs it, where it is missing."""
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise VgrooveError(
            f"{what} needs {package}, which is not installed: pip install 'vgroove[formats]' (or "
            f"pip install {package})."
        ) from error
