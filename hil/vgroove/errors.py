"""The exception whose message is meant for the user; the command line exits with 2 on it."""

from collections.abc import Iterator
from contextlib import contextmanager


class VgrooveError(Exception):
    """Unusable input or a failed device; the message is a sentence that a user can act on."""


@contextmanager
def refused_by_plant(what: str) -> Iterator[None]:
    """Turns errors of the plant into a VgrooveError about `what`: ValueError (it refuses
    a value) and RuntimeError (it cannot simulate a run).
    """
    try:
        yield
    except (ValueError, RuntimeError) as error:
        raise VgrooveError(f"{what}: {error}") from error
