"""The tree follows the rules of text, stages, arguments and Python layout; each rule is itself
tried on a text that breaks it.
"""

import pytest
import python_rules
import text_rules
import tree_rules
from rules import Violation
from text_rules import first_person, history_words, long_lines, metaphors, outside_citations

needs_git = pytest.mark.skipif(not tree_rules.TREE, reason="not in a git work tree")


def explain(violations: list[Violation]) -> str:
    return "\n".join(f"{v.path}:{v.line}: {v.sentence}" for v in violations)


@needs_git
@pytest.mark.parametrize("name", tree_rules.NAMES)
def test_the_tree_follows_the_rule(name: str) -> None:
    found = tree_rules.broken(name)
    assert not found, explain(found)


def test_long_lines_are_caught_but_where_a_reason_is_given() -> None:
    line = "x" * 101
    for path in ("a.py", "Makefile", "docs/a.md", "firmware/a.c", "rigs/a.toml"):
        assert len(long_lines(path, f"short\n{line}\n")) == 1
        assert long_lines(path, line[:100]) == []
    for path in ("docs/results/a.json", "firmware/telemetry/vgroove.dbc", "LICENSE"):
        assert long_lines(path, line) == []
    assert long_lines("docs/a.md", "| " + line) == []
    assert len(long_lines("a.py", "| " + line)) == 1


TRACKED = ("docs/plant.md", "docs/spec/model.md", "rigs/a.toml", "hil/vgroove/rig.py")


@pytest.mark.parametrize(
    "text",
    [
        "see docs/nothing.md",
        "(docs/spec/other.md, section 2)",
        "as rigs/b.toml has it",
        "hil/vgroove/gone.py.",
        "physics" + ".md section 4",
        "the page brief" + ".md",
        "tests/python/*.toml",
    ],
)
def test_a_citation_of_an_untracked_file_is_caught(text: str) -> None:
    assert len({v.sentence for v in text_rules.untracked_citations("a.c", text, TRACKED)}) >= 1


def test_tracked_files_patterns_and_other_paths_may_be_cited() -> None:
    text = (
        "docs/plant.md, rigs/*.toml and hil/vgroove/rig.py; plant.md; build/dev/x.json; "
        "docs/results/<name>.json; https://x.org/docs/a.md; (docs/spec/model.md, section 4)"
    )
    assert text_rules.untracked_citations("a.py", text, TRACKED) == []


@pytest.mark.parametrize(
    "text",
    [
        "cd ../" + "shared",
        "issue 18",
        "see Issue #7",
        "the contract's blocks",
        "gap contract, section 5",
    ],
)
def test_what_lies_outside_the_repository_is_caught(text: str) -> None:
    assert len(outside_citations("a.py", text)) == 1


def test_flags_and_multiplications_are_no_contract() -> None:
    assert outside_citations("CMakeLists.txt", "-ffp-contract=off, no contracted sums") == []


def test_sections_that_a_page_lacks_are_caught() -> None:
    pages = {"model": "## 1. Supply\n\n## 2. Motor\n"}
    good = "// docs/spec/model.md, section 2; docs/spec/model.md,\n// sections 1 and 2"
    assert text_rules.wrong_sections("a.c", good, pages) == []
    bad = "docs/spec/model.md, section 3; docs/spec/gap.md, section 1"
    assert len(text_rules.wrong_sections("a.c", bad, pages)) == 2


HISTORIC = [
    "the solver is now exact",
    "Begins anew at 0.",
    "is no longer read",
    "not used any more",
    "It used to be slower.",
    "there used to live a filter",
    "is still supported",
    "previously a class",
    "was renamed to RPM_PER_RAD_S",
    "as in earlier versions",
]


@pytest.mark.parametrize("text", HISTORIC)
@pytest.mark.parametrize(
    ("path", "form"),
    [
        ("a.c", "int a;  // {}\n"),
        ("a.h", "/* {} */\n"),
        ("a.py", "a = 1  # {}\n"),
        ("a.py", '"""Words.\n\n{}\n"""\n'),
        ("a.md", "# Title\n\n{}\n"),
        ("rigs/a.toml", "a = 1  # {}\n"),
        ("Makefile", "# {}\n"),
    ],
)
def test_words_of_history_are_caught(path: str, form: str, text: str) -> None:
    assert len(history_words(path, form.format(text))) == 1


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("a.c", "uint32_t f(uint32_t now_us, uint32_t now) {}  // since `now`, us\n"),
        ("a.c", "while the motor still turns;  // while the motor still turns: it coasts\n"),
        ("a.py", 'now = "anew, no longer"  # a stretch no longer than a row, now and then\n'),
        ("a.py", "# the table is used to find the row; what is used to start with\n"),
        ("a.md", "The shaft stands still.\n```\nnow anew\n```\n`now` is an argument.\n"),
    ],
)
def test_run_time_names_and_code_are_no_history(path: str, text: str) -> None:
    assert history_words(path, text) == []


def test_the_first_person_is_caught() -> None:
    assert len(first_person("a.py", "# we divide by our step\n")) == 2
    assert first_person("a.py", "# 16 us after the trigger; power; hours\n") == []


@pytest.mark.parametrize(
    ("path", "line", "count"),
    [
        ("cleaning/clock.py", "from vgroove.gap.hall_edges import reader", 1),
        ("hall_edges/reader.py", "from vgroove.gap.cleaning.clock import a, b", 0),
        ("residual/problem.py", "import vgroove.gap.fitting.fit", 1),
        ("fitting/fit.py", "from ..selection import search", 1),
        ("fitting/fit.py", "from . import normal_equations", 0),
        ("selection/search.py", "from vgroove.gap.diagnose import diagnose", 1),
        ("selection/search.py", "def f():\n    from vgroove.gap import verdict", 1),
        ("catalogue/effects.py", "from vgroove.gap.cleaning import clock", 1),
        ("catalogue/effects.py", "from vgroove.gap import diagnose", 1),
        ("cleaning/clock.py", "from vgroove.gap.catalogue import effects", 0),
        ("next_run/menu.py", "from vgroove.gap.verdict.decision import decide", 0),
        ("diagnose.py", "from vgroove.gap.next_run import menu", 0),
        ("__init__.py", "from vgroove.gap.diagnose import diagnose", 0),
    ],
)
def test_imports_back_to_an_earlier_stage_are_caught(path: str, line: str, count: int) -> None:
    assert bool(python_rules.stage_violations(f"{python_rules.GAP}/{path}", line + "\n")) == bool(
        count
    )
    assert python_rules.stage_violations(f"hil/vgroove/{path}", line + "\n") == []


def test_a_function_of_six_arguments_is_caught() -> None:
    path = f"{python_rules.GAP}/a.py"
    five, six = "a, b, c, d, e", "a, b, c, *, d, e=1, **f"
    assert python_rules.many_arguments(path, f"def f({five}): ...\n") == []
    assert python_rules.many_arguments(path, f"class A:\n    def f(self, {five}): ...\n") == []
    assert len(python_rules.many_arguments(path, f"def f({six}): ...\n")) == 1
    assert python_rules.many_arguments("tests/a.py", f"def f({six}): ...\n") == []
    command = f"@app.command('x')\ndef f({six}): ...\n"
    assert python_rules.many_arguments("hil/vgroove/cli.py", command) == []


def test_an_attribute_looked_up_by_a_literal_name_is_caught() -> None:
    path = f"{python_rules.GAP}/a.py"
    text = 'a = getattr(b, "c", None)\nif hasattr(b, "d"):\n    pass\n'
    assert len(python_rules.literal_attributes(path, text)) == 2
    assert python_rules.literal_attributes(path, "a = getattr(b, name)\n") == []


@pytest.mark.parametrize(
    "text",
    [
        "an angle that no log tells",
        "at rest, as far as it tells",
        "corrected as far as its covariance tells",
        "a finding that speaks against the log",
        "a count that says little about the speed",
        "the believed firmware",
        "a gain that is credited to an effect",
    ],
)
def test_a_metaphor_is_caught(text: str) -> None:
    assert len(metaphors("a.py", f"# {text}\n")) == 1


def test_terms_of_the_field_are_no_metaphors() -> None:
    assert metaphors("a.py", "# two runs that tell effects apart; findings against a log\n") == []
