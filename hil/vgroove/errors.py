"""The one exception that carries a sentence for the user; the CLI prints it and exits 2."""


class VgrooveError(Exception):
    """Unusable input or a failed device; the message is a sentence that a user can act on."""
