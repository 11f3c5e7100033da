"""Rules of the Python code in the package: imports between the stages of the diagnosis, number of
arguments, no attributes looked up by a literal name.
"""

import ast

from rules import Violation

GAP = "hil/vgroove/gap"
# Stages of the diagnosis in their order: a later one may import an earlier one, never back. All may
# import the catalogue, which imports nothing of the diagnosis.
STAGES = (
    "cleaning",
    "hall_edges",
    "residual",
    "fitting",
    "selection",
    "verdict",
    "next_run",
)
CATALOGUE = "catalogue"

ARGUMENTS_LIMIT = 5
FEW_ARGUMENTS = ("hil",)  # folders whose functions take at most ARGUMENTS_LIMIT arguments


def stage_of(module: str) -> str | None:
    """Part of the package vgroove.gap that a module belongs to: a stage, `catalogue`, `top`; None
    for modules outside it.
    """
    parts = module.split(".")
    if parts[:2] != ["vgroove", "gap"]:
        return None
    return parts[2] if len(parts) > 2 and parts[2] in (*STAGES, CATALOGUE) else "top"


def imported_modules(path: str, tree: ast.AST) -> list[tuple[int, str]]:
    """Line and dotted name of every module that a file of the package imports; a name imported from
    a package counts as a module of it.
    """
    own = path.removeprefix("hil/").removesuffix(".py").removesuffix("/__init__").split("/")
    package = own if path.endswith("__init__.py") else own[:-1]
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found += [(node.lineno, alias.name) for alias in node.names]
        if isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            name = ".".join([*base, *((node.module or "").split(".") if node.module else [])])
            found += [(node.lineno, f"{name}.{alias.name}") for alias in node.names]
    return found


def may_import(stage: str, other: str) -> bool:
    """Whether a module of one part of the diagnosis may import one of another."""
    if stage in (other, "top"):
        return True
    if stage == CATALOGUE or other == "top":
        return False
    return other == CATALOGUE or STAGES.index(other) < STAGES.index(stage)


def stage_violations(path: str, text: str) -> list[Violation]:
    """Imports between the stages of the diagnosis that go back."""
    stage = stage_of(path.removeprefix("hil/").removesuffix(".py").replace("/", "."))
    if stage is None or not path.startswith("hil/"):
        return []
    return [
        Violation(path, line, f"{stage} must not import {name}")
        for line, name in imported_modules(path, ast.parse(text))
        if (other := stage_of(name)) is not None and not may_import(stage, other)
    ]


def argument_count(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Arguments of a function, self and cls left out; *args and **kwargs are one each."""
    of = function.args
    names = [a.arg for a in (*of.posonlyargs, *of.args)]
    first_is_own = bool(names) and names[0] in ("self", "cls")
    return len(names) + len(of.kwonlyargs) + bool(of.vararg) + bool(of.kwarg) - first_is_own


def is_command(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    """Whether a function is a command of the terminal (`@app.command(...)`), whose arguments are
    options.
    """
    calls = (d.func for d in function.decorator_list if isinstance(d, ast.Call))
    return any(isinstance(call, ast.Attribute) and call.attr == "command" for call in calls)


def many_arguments(path: str, text: str) -> list[Violation]:
    """Functions with more than ARGUMENTS_LIMIT arguments, but commands of the terminal."""
    if not path.startswith(tuple(folder + "/" for folder in FEW_ARGUMENTS)):
        return []
    return [
        Violation(path, node.lineno, f"{node.name} takes {count} arguments")
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and not is_command(node)
        and (count := argument_count(node)) > ARGUMENTS_LIMIT
    ]


def literal_attributes(path: str, text: str) -> list[Violation]:
    """`hasattr` and `getattr` with a literal name: the type of the object is to say what it has."""
    if not path.startswith(GAP + "/"):
        return []
    return [
        Violation(path, node.lineno, f"{node.func.id} of {node.args[1].value!r}")
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in ("hasattr", "getattr")
        and len(node.args) > 1
        and isinstance(node.args[1], ast.Constant)
    ]
