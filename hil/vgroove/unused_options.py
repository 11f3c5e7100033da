"""Options that belong to another mode of a command: refused where they are given, since a run that
ignores one is not the run that was meant.
"""

from collections.abc import Sequence

import typer

from vgroove.errors import VgrooveError


def refuse_given(context: typer.Context, parameters: Sequence[str], sentence: str) -> None:
    """VgrooveError with the options, among the command's parameters of these names, that the
    command line gives, followed by the sentence.
    """
    names = [
        "/".join((parameter.opts[-1], *parameter.secondary_opts))
        for parameter in context.command.params
        if parameter.name in parameters and _is_given(context, parameter.name)
    ]
    if names:
        raise VgrooveError(f"{', '.join(names)}: {sentence}")


def _is_given(context: typer.Context, parameter: str) -> bool:
    source = context.get_parameter_source(parameter)
    return source is not None and source.name == "COMMANDLINE"
