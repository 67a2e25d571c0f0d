"""Domain files are data: whatever is in them, the loader answers with a domain or with
diagnostics, and soon.
"""

import os
import re
import time
from contextlib import suppress
from pathlib import Path

import pytest

from cellwright.kb.asp import AspError, ground_term
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.files import MAX_FILE_BYTES
from cellwright.kb.loader import find_target, load, load_plan
from cellwright.kb.syntax import ExpressionError, parse_expression

DOMAIN = """domain: cell
include: [rules.lp]
types:
  item: object
objects:
  item: [bolt]
statics:
  heavy(item): {}
fluents:
  seen(item): {}
operators:
  look(Item):
    where: heavy(Item)
    adds: seen(Item)
"""
PROBLEM = "problem: all\ndomain: cell\ngoals: [seen(bolt)]\n"
SECONDS = 5.0


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    write(tmp_path, DOMAIN, "heavy(bolt).\n", PROBLEM)
    return tmp_path


def write(folder: Path, domain: str, rules: str = "", problem: str = PROBLEM) -> None:
    (folder / "domain.yaml").write_text(domain, "utf-8")
    (folder / "rules.lp").write_text(rules, "utf-8")
    (folder / "problem.yaml").write_text(problem, "utf-8")


def codes(path: Path) -> set[str]:
    started = time.process_time()
    try:
        load(path)
    except InvalidInput as error:
        printed = str(error)
        assert len(printed) < 1_000_000
        return {each.code for each in error.diagnostics}
    finally:
        assert time.process_time() - started < SECONDS
    return set()


def test_the_cell_itself_is_sound(cell: Path) -> None:
    assert codes(cell / "domain.yaml") == codes(cell / "problem.yaml") == set()


def test_a_folder_is_no_file(cell: Path) -> None:
    assert codes(cell) == {"K001"}


def test_a_missing_file(cell: Path) -> None:
    assert codes(cell / "nothing.yaml") == {"K001"}


def test_a_pipe_is_not_waited_for(cell: Path) -> None:
    os.mkfifo(cell / "pipe.yaml")
    assert codes(cell / "pipe.yaml") == {"K001"}
    (cell / "rules.lp").unlink()
    os.mkfifo(cell / "rules.lp")
    assert codes(cell / "domain.yaml") == {"K203"}


def test_an_endless_device_is_not_read() -> None:
    assert codes(Path("/dev/zero")) == {"K001"}


def test_a_name_that_no_file_can_have(cell: Path) -> None:
    assert codes(cell / ("x" * 5000)) == codes(Path("a\0b")) == {"K001"}
    for target in ("x" * 5000, "a\0b", "", "/", "themse/" + "y" * 300):
        with pytest.raises(InvalidInput, match="K401"):
            find_target(target)


@pytest.mark.skipif(os.geteuid() == 0, reason="nothing is unreadable for root")
def test_a_file_without_permission(cell: Path) -> None:
    (cell / "domain.yaml").chmod(0)
    assert codes(cell / "domain.yaml") == {"K001"}


def test_a_file_that_is_too_large(cell: Path) -> None:
    with (cell / "domain.yaml").open("wb") as file:
        file.truncate(10**12)
    assert codes(cell / "domain.yaml") == {"K007"}


@pytest.mark.parametrize(
    "content", [b"\xff\xfe\0d", b"domain: \xe9", b"domain: a\0b", b"\x80", b"domain: cell\x1b[2J"]
)
def test_bytes_that_are_no_text(cell: Path, content: bytes) -> None:
    (cell / "domain.yaml").write_bytes(content)
    assert codes(cell / "domain.yaml") == {"K001"}


@pytest.mark.parametrize("content", ["", "\n\n", "# nothing\n", "---\n", "\ufeff"])
def test_an_empty_file(cell: Path, content: str) -> None:
    (cell / "domain.yaml").write_text(content, "utf-8")
    assert codes(cell / "domain.yaml") & {"K002", "K005"}


@pytest.mark.parametrize(
    "content", ["just words", "- a\n- list", "12", "null", "[]", "{}", "~", "? a\n: b", "'': x"]
)
def test_a_file_that_is_no_domain(cell: Path, content: str) -> None:
    (cell / "domain.yaml").write_text(content, "utf-8")
    assert "K005" in codes(cell / "domain.yaml")


def test_an_alias_bomb(cell: Path) -> None:
    bomb = "a0: &a0 [x, x]\n" + "".join(
        f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]\n" for n in range(1, 60)
    )
    (cell / "domain.yaml").write_text(bomb)
    assert "K004" in codes(cell / "domain.yaml")


@pytest.mark.parametrize(
    "nested", ["[" * 10_000, "{a: " * 10_000, "- " * 10_000 + "x", "[" * 10**6]
)
def test_deep_nesting_of_yaml(cell: Path, nested: str) -> None:
    (cell / "domain.yaml").write_text("domain: cell\ntypes: \n  " + nested)
    assert codes(cell / "domain.yaml") & {"K002", "K007"}


@pytest.mark.parametrize(
    "old",
    ["where: heavy(Item)", "adds: seen(Item)", "heavy(item): {}", "look(Item):", "domain: cell"],
)
@pytest.mark.parametrize("depth", [60, 10_000, 1_000_000])
def test_deep_terms_in_yaml(cell: Path, old: str, depth: int) -> None:
    key, _, _ = old.partition(":")
    write(cell, DOMAIN.replace(old, f"{key}: '{'f(' * depth}a{')' * depth}'"))
    assert codes(cell / "domain.yaml")


@pytest.mark.parametrize("depth", [120, 10_000, 500_000])
@pytest.mark.parametrize("start", ["atom", "conditions", "body", "clauses", "term", "terms"])
def test_deep_terms_are_refused_by_the_parser(start: str, depth: int) -> None:
    for text in (
        "f(" * depth + "a" + ")" * depth,
        "(" * depth,
        "1" + "+1" * depth,
        "p(" + "(" * depth + "a" + ")" * depth + ")",
    ):
        with pytest.raises(ExpressionError):
            parse_expression(start, text)


@pytest.mark.parametrize(
    "text",
    ["f(" * 10**5 + "a" + ")" * 10**5, "1" + "+1" * 10**5, "p(é)", "p(\0)", "p(99999999999)"],
)
def test_terms_that_clingo_cannot_be_trusted_with(text: str) -> None:
    with pytest.raises(AspError):
        ground_term(text)


@pytest.mark.parametrize(
    ("rules", "code"),
    [
        ("#script (python)\nimport os; os.abort()\n#end.\n", "K202"),
        ('#script(lua) " #end. #include "/etc/passwd".\n', "K202"),
        ('#include "/etc/passwd".\n', "K203"),
        ('heavy(X) :- X = @system("true").\n', "K202"),
        ("heavy(bolt) :- " + "(" * 200_000 + ".\n", "K007"),
        ("heavy(" + "f(" * 300_000 + "a" + ")" * 300_000 + ").\n", "K007"),
        ("heavy(1" + "+1" * 300_000 + ").\n", "K007"),
        ("heavy(" + "-" * 300_000 + "1).\n", "K007"),
        ("heavy((" + "),(".join("a;b;c;d;e;f;g;h;i;j" for _ in range(12)) + ")).\n", "K007"),
        ("heavy(1..1000000000).\n", "K007"),
        ("heavy(99999999999).\n", "K113"),
        ("heavy(é).\n", "K201"),
        ("heavy(X).\n", "K105"),
        ("heavy(bolt). % a comment with é\nheavy(bolt", "K201"),
        ("% " + "x" * 1_000_000, "K007"),
        ("{ heavy(X) : item(X) }.", "K202"),
        ("heavy(X) ; item(X) :- item(X).", "K202"),
        ("-heavy(bolt).", "K202"),
        ("&sum { x } > 3.", "K202"),
        ("#external heavy(bolt).", "K202"),
        ("#minimize { 1 : heavy(bolt) }.", "K202"),
        ("#const bolt = 3.", "K104"),
        ("_violated(0).", "K112"),
        ("heavy(bolt) :- _violated(0).", "K112"),
        ("heavy(_bolt).", "K112"),
        ("#program check(x).\nheavy(bolt).", "K202"),
        ("object(thing).", "K108"),
        ("a :- not b. b :- not a.", "K201"),
    ],
)
def test_rules_that_domain_files_may_not_contain(cell: Path, rules: str, code: str) -> None:
    write(cell, DOMAIN, rules)
    assert code in codes(cell / "domain.yaml")


@pytest.mark.parametrize(
    "name", ["/etc/passwd", "../rules.lp", "inside/../../rules.lp", "link.lp", "linked/rules.lp"]
)
def test_includes_stay_in_the_folder(tmp_path: Path, name: str) -> None:
    inner = tmp_path / "cell"
    inner.mkdir()
    (tmp_path / "rules.lp").write_text("heavy(bolt).\n")
    (inner / "inside").mkdir()
    (inner / "link.lp").symlink_to(tmp_path / "rules.lp")
    (inner / "linked").symlink_to(tmp_path)
    write(inner, DOMAIN.replace("rules.lp", name))
    assert codes(inner / "domain.yaml") == {"K203"}


def test_links_in_a_circle(cell: Path) -> None:
    (cell / "a.lp").symlink_to(cell / "b.lp")
    (cell / "b.lp").symlink_to(cell / "a.lp")
    write(cell, DOMAIN.replace("rules.lp", "a.lp"))
    assert codes(cell / "domain.yaml") == {"K203"}


@pytest.mark.parametrize(
    "name", ["'a\\0b'", '"a\\0b"', "x" * 5000, "''", ".", "inside", "rules.lp/x"]
)
def test_strange_names_of_includes(cell: Path, name: str) -> None:
    write(cell, DOMAIN.replace("rules.lp", name))
    assert codes(cell / "domain.yaml") & {"K203", "K004", "K005"}


@pytest.mark.parametrize(
    ("listed", "code"),
    [
        ("p_1..1000000000", "K007"),
        ("p_1..99999999999999999999", "K007"),
        ("p_1..999999", "K007"),
        (", ".join(f"p{n}_1..90000" for n in range(50)), "K007"),
        ("p_5..1", "K113"),
        ("P", "K112"),
        ("_p", "K112"),
        ("not", "K112"),
        ("p-1", "K112"),
        ("12", "K112"),
        ("'a b'", "K112"),
        ("bolt", "K104"),
        ("[bolt]", "K005"),
    ],
)
def test_lists_of_objects(cell: Path, listed: str, code: str) -> None:
    if listed == "[bolt]":
        write(cell, DOMAIN.replace("item: [bolt]", "item: [[bolt]]"))
    else:
        write(cell, DOMAIN.replace("[bolt]", f"[bolt, {listed}]"))
    assert codes(cell / "domain.yaml") == {code}


@pytest.mark.parametrize("name", ["on", "no", "yes", "true", "null", "y", "off"])
def test_words_that_yaml_would_turn_into_something_else_are_names(cell: Path, name: str) -> None:
    write(cell, DOMAIN.replace("[bolt]", f"[bolt, {name}]"), problem=PROBLEM.replace("bolt", name))
    assert codes(cell / "problem.yaml") == set()
    loaded = load(cell / "problem.yaml")
    assert str(loaded.problem.goal if loaded.problem else "") == f"seen({name})"


@pytest.mark.parametrize(("written", "read"), [("0755", 755), ("010", 10), ("12", 12)])
def test_numbers_are_what_is_written(cell: Path, written: str, read: int) -> None:
    write(cell, DOMAIN + f"    duration: {written}\n")
    duration = load(cell / "domain.yaml").domain.operators[0].duration
    assert str(duration) == str(read)


@pytest.mark.parametrize("written", ["12:30", "1e3", "0x1F", "1_000", "2.5", ".inf", "-1", "="])
def test_numbers_of_other_kinds_are_refused(cell: Path, written: str) -> None:
    write(cell, DOMAIN + f"    duration: {written}\n")
    assert codes(cell / "domain.yaml")


@pytest.mark.parametrize(
    "weight", ["5.0", "1_0", "' 5'", "1e1", "-1", "99999999999", "true", "[]", "five", "9" * 5000]
)
def test_weights_are_whole_numbers(cell: Path, weight: str) -> None:
    write(cell, DOMAIN.replace("seen(item): {}", f"seen(item): {{weight: {weight}}}"))
    assert codes(cell / "domain.yaml") == {"K005"}


def test_a_megabyte_in_one_expression(cell: Path) -> None:
    write(cell, DOMAIN.replace("adds: seen(Item)", "adds: " + ", ".join(["seen(Item)"] * 100_000)))
    assert "K007" in codes(cell / "domain.yaml")
    write(cell, DOMAIN, problem=PROBLEM.replace("seen(bolt)", "seen(" + "b" * 2**20 + ")"))
    assert "K007" in codes(cell / "problem.yaml")


@pytest.mark.slow
def test_a_line_of_a_megabyte_does_not_slow_its_messages(cell: Path) -> None:
    names = ", ".join(f"Name{n}" for n in range(90_000))
    write(cell, DOMAIN.replace("[bolt]", f"[bolt, {names}]"))
    assert codes(cell / "domain.yaml") == {"K112"}


def test_a_workflow_of_a_billion_chains(cell: Path) -> None:
    many = "".join(f"      V{n}: [i1..1000]\n" for n in range(3))
    text = (
        f"problem: all\ndomain: cell\nobjects:\n  item: [i1..1000]\nworkflow:\n  - for:\n{many} "
        "   stages: seen(V0), seen(V1), seen(V2)\n"
    )
    write(cell, DOMAIN, "heavy(bolt).\n", text)
    assert codes(cell / "problem.yaml") == {"K007"}


def test_a_long_chain_of_rules_takes_linear_time(cell: Path) -> None:
    rules = "p0(X) :- seen(X).\n" + "".join(f"p{n + 1}(X) :- p{n}(X).\n" for n in range(1500))
    write(cell, DOMAIN, rules)
    assert codes(cell / "domain.yaml") == {"K108"}


@pytest.mark.parametrize(
    "domain", ["/dev/zero", "..", "a\\0b", "x" * 5000, "/", "''", "problem.yaml"]
)
def test_a_problem_of_a_strange_domain(cell: Path, domain: str) -> None:
    write(cell, DOMAIN, problem=PROBLEM.replace("domain: cell", f"domain: {domain}"))
    assert codes(cell / "problem.yaml")


@pytest.mark.parametrize(
    ("say", "code"),
    [
        ("(" * 20_000 + "look {I:item}" + ")" * 20_000, "K601"),
        ("(" * 30 + "look {I:item}" + ")" * 30, "K601"),
        ("[b] " * 50 + "look {I:item}", "K601"),
        ("look " * 5000 + "{I:item}", "K601"),
    ],
)
def test_phrases_that_would_never_end(cell: Path, say: str, code: str) -> None:
    phrases = f"commands:\n  phrases:\n    - say: '{say}'\n      goal: seen(I)\n"
    write(cell, DOMAIN + phrases)
    assert codes(cell / "domain.yaml") == {code}


def test_more_words_than_anyone_says(cell: Path) -> None:
    many = ", ".join(f"w{chr(97 + n % 26)}{'x' * (n % 40)}" for n in range(20_000))
    write(cell, DOMAIN + f"commands:\n  words:\n    item: [{many}]\n")
    assert codes(cell / "domain.yaml") == {"K007"}


@pytest.mark.parametrize(
    "written", ["\ufeff" + DOMAIN, DOMAIN.replace("\n", "\r\n"), DOMAIN.replace("\n", "\r")]
)
def test_byte_order_marks_and_line_ends_of_other_systems(cell: Path, written: str) -> None:
    (cell / "domain.yaml").write_bytes(written.encode())
    assert codes(cell / "problem.yaml") == set()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("look(Item)", "~"),
        ("look(Item)", "look(Item"),
        ("heavy(item)", "heavy(item, 3)"),
        ("where: heavy(Item)", "where: '?'"),
        ("where: heavy(Item)", "where: heavy(Item) Item"),
        ("adds: seen(Item)", "adds: not seen(Item)"),
        ("adds: seen(Item)", "adds: seen(Item)\n    duration: 15 days"),
        ("adds: seen(Item)", "adds: seen(Item)\n    resources: a b"),
    ],
)
def test_what_is_no_expression_gets_a_hint(cell: Path, old: str, new: str) -> None:
    write(cell, DOMAIN.replace(old, new))
    with pytest.raises(InvalidInput) as raised:
        load(cell / "domain.yaml")
    assert all(each.hint for each in raised.value.diagnostics)


PLAN = """{"version": 1, "status": "found", "data": {"plan": {
"problem": {"problem": "one", "domain": "themse", "goals": ["position(flap, open)"]},
"steps": [{"id": 1, "operator": "press_switch(closed, open)", "after": [], "duration": 3, "cost": 1}],
"links": [{"producer": 0, "condition": "free(mars_gripper)", "consumer": 1}]}}}
"""
KEYS = [
    "id",
    "operator",
    "after",
    "duration",
    "cost",
    "producer",
    "condition",
    "consumer",
    "domain",
    "goals",
]
STRANGE = [
    "1.0",
    '"1_0"',
    "null",
    "[[1]]",
    "{}",
    "-1",
    "1e9",
    "true",
    "9" * 5000,
    '"p(é)"',
    '"\\u0000"',
    '"f(((("',
]


@pytest.mark.parametrize("key", KEYS)
def test_plan_files_are_answered(key: str, tmp_path: Path) -> None:
    for value in STRANGE:
        text = re.sub(
            rf'"{key}": ("[^"]*"|\[[^]]*\]|[0-9]+)',
            f'"{key}": {value}'.replace("\\", "\\\\"),
            PLAN,
            count=1,
        )
        assert text != PLAN
        (tmp_path / "plan.json").write_text(text, "utf-8")
        with suppress(InvalidInput):
            load_plan(tmp_path / "plan.json")
    (tmp_path / "plan.json").write_text(PLAN)
    assert len(load_plan(tmp_path / "plan.json")[1].steps) == 1


@pytest.mark.slow
def test_a_plan_file_may_be_longer_than_other_files(tmp_path: Path) -> None:
    """A plan of fifty thousand steps has some 20 MiB and two million values."""
    (tmp_path / "plan.json").write_text(PLAN + " " * MAX_FILE_BYTES)
    assert len(load_plan(tmp_path / "plan.json")[1].steps) == 1
