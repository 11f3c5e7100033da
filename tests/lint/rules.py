"""Rules of the source tree as functions over source text: which folder may include or import which,
how long a function may be, how a file opens.
"""

import ast
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
C_ENDINGS = {".c", ".h", ".cpp", ".hpp"}
FUNCTION_LINES_LIMIT = 60

# Folder -> folders whose files it may include or import. A folder may always use itself; the C
# library and third-party libraries are not checked.
MAY_USE = {
    "firmware/core": set(),
    "firmware/controllers": {"firmware/core"},
    "firmware/telemetry": {"firmware/core"},
    "firmware/drivers": {"firmware/core", "firmware/hal"},
    "firmware/app": {
        "firmware/core",
        "firmware/controllers",
        "firmware/drivers",
        "firmware/telemetry",
        "firmware/hal",
    },
    "firmware/hal": {"firmware/core", "firmware/drivers", "firmware/app"},
    "plant/numeric": set(),
    "plant/components": {"plant/numeric"},
    "plant/drivetrain": {"plant/numeric", "plant/components"},
    "plant/impact": {"plant/numeric", "plant/components", "plant/drivetrain"},
    "plant/drill": {"plant/numeric", "plant/components"},
    "plant/lockstep": {
        "plant/numeric",
        "plant/components",
        "plant/drivetrain",
        "plant/impact",
        "plant/drill",
    },
    "plant": set(),
    "hil": {
        "plant/numeric",
        "plant/components",
        "plant/drivetrain",
        "plant/impact",
        "plant/drill",
        "plant/lockstep",
        "firmware/hal",
    },
    "hil/fixed_point": {"firmware/core", "firmware/controllers", "firmware/drivers"},
    "tests/truth": set(),
}
USES_ALL = ("tests",)


@dataclass(frozen=True)
class Violation:
    """One broken rule: where, and the sentence that says which."""

    path: str
    line: int
    sentence: str


def folder_of(path: str) -> str | None:
    """The longest folder of MAY_USE and USES_ALL that holds a repository path, or None."""
    folders = [f for f in (*MAY_USE, *USES_ALL) if path == f or path.startswith(f + "/")]
    return max(folders, key=len, default=None)


def resolve(path: str, spelling: str, known: dict[str, str]) -> str | None:
    """The header of this repository that an include line in `path` finds: one beside it first, as
    the compiler does; None for foreign headers.
    """
    beside = f"{path.rsplit('/', 1)[0]}/{spelling}"
    return beside if beside in known.values() else known.get(spelling)


def include_violations(path: str, text: str, known: dict[str, str]) -> list[Violation]:
    """Includes of `path` that go against MAY_USE; `known` maps each way a project header can be
    spelled to its repository path.
    """
    folder = folder_of(path)
    if folder is None or folder in USES_ALL:
        return []
    found = []
    for number, line in enumerate(text.splitlines(), 1):
        match = re.match(r'\s*#\s*include\s+["<]([^">]+)[">]', line)
        target = resolve(path, match.group(1), known) if match else None
        other = folder_of(target) if target else None
        if other and other != folder and other not in MAY_USE[folder]:
            found.append(
                Violation(path, number, f"{folder} must not include {other} ({match.group(1)})")
            )
    return found


def imported_names(node: ast.AST) -> list[str]:
    """Modules that an import statement names; empty for every other node."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    return [node.module or ""] if isinstance(node, ast.ImportFrom) else []


def import_violations(path: str, text: str) -> list[Violation]:
    """Imports of a Python file that go the wrong way: the package imports no tests, the
    independent generator (tests/truth) imports nothing of this project.
    """
    folder = folder_of(path)
    forbidden = {"hil": ("tests", "truth"), "tests/truth": ("vgroove", "tests")}.get(
        folder or "", ()
    )
    found = []
    for node in ast.walk(ast.parse(text)):
        for name in imported_names(node):
            if name.split(".")[0] in forbidden:
                found.append(Violation(path, node.lineno, f"{folder} must not import {name}"))
    return found


def long_python_functions(path: str, text: str) -> list[Violation]:
    """Python functions longer than the limit, docstrings not counted."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        doc = node.body[0] if ast.get_docstring(node, clean=False) else None
        lines = (
            (node.end_lineno or node.lineno)
            - node.lineno
            + 1
            - ((doc.end_lineno or 0) - doc.lineno + 1 if doc else 0)
        )
        if lines > FUNCTION_LINES_LIMIT:
            found.append(
                Violation(
                    path,
                    node.lineno,
                    f"{node.name} has {lines} lines, the limit is {FUNCTION_LINES_LIMIT}",
                )
            )
    return found


NO_CODE = re.compile(
    r'//[^\n]*|/\*.*?\*/|"(?:\\.|[^"\\\n])*"|\'(?:\\.|[^\'\\\n])*\'|'
    r"^[ \t]*#(?:\\\n|[^\n])*|\b(?:public|private|protected)[ \t]*:",
    re.DOTALL | re.MULTILINE,
)
NO_FUNCTION = re.compile(
    r"\s*(?:(?:if|else|for|while|do|switch|catch|try|return|namespace|enum|extern|\w+\s+alignas)\b|"
    r"[^()]*$|[^(]*[^=!<>(]=[^=])"
)


def code_only(text: str) -> str:
    """C source with comments, literals and preprocessor lines as blanks, a{1} as a(1); every
    character keeps its place.
    """
    plain = NO_CODE.sub(lambda match: re.sub(r"[^\n]", " ", match.group()), text)
    return re.sub(r"(?<=\w)\{([^{}\n]*)\}", r"(\1)", plain)


def c_functions(text: str) -> list[tuple[int, int, str]]:
    """Functions of C or C++ source, members of classes too: first line of the signature, line of
    the closing brace, signature.
    """
    found, head, parens, depth, inside = [], 0, 0, 0, None
    code = code_only(text)
    for at, sign in enumerate(code):
        parens += (sign == "(") - (sign == ")")
        if sign == "{" and parens == 0:
            depth += 1
            if inside is None and not NO_FUNCTION.match(code[head:at]):
                inside = (depth, at - len(code[head:at].lstrip()))
        if sign == "}" and parens == 0:
            if inside and inside[0] == depth:
                first, last = (code.count("\n", 0, place) + 1 for place in (inside[1], at))
                found.append((first, last, " ".join(code[inside[1] : at].split("{")[0].split())))
                inside = None
            depth -= 1
        if sign in "{};" and parens == 0:
            head = at + 1
    return found


def long_c_functions(path: str, text: str) -> list[Violation]:
    """C and C++ functions longer than the limit, from the first line of the signature, however it
    is wrapped, to the closing brace.
    """
    return [
        Violation(
            path,
            first,
            f"{signature} has {last - first + 1} lines, the limit is {FUNCTION_LINES_LIMIT}",
        )
        for first, last, signature in c_functions(text)
        if last - first + 1 > FUNCTION_LINES_LIMIT
    ]


def long_functions(path: str, text: str) -> list[Violation]:
    """Functions of a Python, C or C++ file that are longer than the limit."""
    if path.endswith(".py"):
        return long_python_functions(path, text)
    return long_c_functions(path, text) if Path(path).suffix in C_ENDINGS else []


def missing_opening(path: str, text: str) -> list[Violation]:
    """A file opens with one sentence: what it is for (after the licence line of the GPL bench
    tool).
    """
    lines = [
        line
        for line in text.splitlines()
        if line.strip() and not line.startswith(("#!", "// SPDX", "# SPDX", "/* SPDX"))
    ]
    opening = lines[0].lstrip() if lines else ""
    sentence = (
        opening.startswith(("//", "/*", '"""', 'r"""'))
        if Path(path).suffix != ".cmake"
        else opening.startswith("#")
    )
    return (
        []
        if sentence
        else [Violation(path, 1, "the file does not open with a sentence that says what it is for")]
    )


def gpl_violations(path: str, text: str) -> list[Violation]:
    """simavr is GPL: only hil/board and the bench's own test probes may include it."""
    if path.startswith("hil/board/"):
        return []
    return [
        Violation(path, n, "only hil/board may include simavr")
        for n, line in enumerate(text.splitlines(), 1)
        if re.match(
            r"\s*#\s*include\s+[<\"](simavr/|sim_avr|avr_(ioport|uart|adc|timer|eeprom)\.h)", line
        )
    ]


def tracked_files(endings: set[str]) -> list[str]:
    """Repository paths of the source files with one of the endings, build and environment folders
    left out.
    """
    folders = ("firmware", "plant", "hil", "tests", "cmake")
    return sorted(
        str(p.relative_to(ROOT))
        for folder in folders
        for p in (ROOT / folder).rglob("*")
        if p.suffix in endings and not {"__pycache__", "build"} & set(p.parts)
    )


def known_headers() -> dict[str, str]:
    """Each way in which a header of this repository can be spelled in an include line -> its path
    in the repository.
    """
    known: dict[str, str] = {}
    for path in tracked_files({".h", ".hpp"}):
        parts = path.split("/")
        for start in range(len(parts)):
            known.setdefault("/".join(parts[start:]), path)
    return known


def repository_paths() -> list[str]:
    """Paths of all tracked files; none outside a git work tree."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    paths = listed.stdout.decode().split("\0") if listed.returncode == 0 else []
    return [path for path in paths if (ROOT / path).is_file()]


def repository_files() -> dict[str, str]:
    """Repository path -> text of every tracked text file; empty outside a git work tree."""
    read = {path: (ROOT / path).read_bytes() for path in repository_paths()}
    return {
        path: data.decode("utf-8", errors="replace")
        for path, data in read.items()
        if b"\0" not in data
    }
