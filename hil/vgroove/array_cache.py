"""Keeps the last results of functions whose arguments are arrays. A diagnosis loads the same log
several times (nominal rig, corrected rig, each whitening), and computes its edge periods once.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import is_dataclass
from functools import wraps
from hashlib import blake2b
from threading import Lock
from typing import Any

import numpy as np

_MISSING = object()


def cached_by_content(most: int) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Decorator of a function whose result depends on its positional arguments alone, arrays and
    dataclasses of arrays among them: the `most` last results are kept. All calls with equal
    arguments return the same object, whose arrays must not be written.
    """

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        kept: OrderedDict[Hashable, Any] = OrderedDict()
        lock = Lock()

        @wraps(function)
        def cached(*arguments: Any) -> Any:
            key = tuple(_content(argument) for argument in arguments)
            with lock:
                found = kept.pop(key, _MISSING)
                if found is not _MISSING:
                    kept[key] = found
            if found is _MISSING:
                found = function(*arguments)
                with lock:
                    kept[key] = found
                    while len(kept) > most:
                        kept.popitem(last=False)
            return found

        return cached

    return decorate


def _content(argument: Any) -> Hashable:
    """An array's type, shape and a hash of its bytes; those of each field of a dataclass; other
    arguments as they are.
    """
    if is_dataclass(argument):
        return tuple(_content(value) for value in vars(argument).values())
    if not isinstance(argument, np.ndarray):
        return argument
    data = np.ascontiguousarray(argument)
    return data.dtype.str, data.shape, blake2b(data, digest_size=16).digest()
