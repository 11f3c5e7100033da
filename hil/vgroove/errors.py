"""The one exception that carries a sentence for the user; the CLI prints it and exits 2."""

from collections.abc import Iterator
from contextlib import contextmanager


class VgrooveError(Exception):
    """Unusable input or a failed device; the message is a sentence that a user can act on."""


@contextmanager
def refused_by_plant(what: str) -> Iterator[None]:
    """What the plant will not or cannot simulate becomes a sentence about `what` (ValueError: a
    value, RuntimeError: a run).
    """
    try:
        yield
    except (ValueError, RuntimeError) as error:
        raise VgrooveError(f"{what}: {error}") from error
