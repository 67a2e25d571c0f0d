"""A seeded sample of mutants of some files, as JSON: run by the Python that has cosmic-ray, called
by `mutation.py`.

    python benchmarks/mutants.py --seed N --count N FILE...

Mutations are cosmic-ray's own, and one more: a statement is deleted, since a rule that can be
deleted is the hole that matters most. Every place has the same chance, whatever the number of its
mutations. Left out is what says nothing of behaviour: annotations, how dataclasses are stored, and
identity in place of equality.
"""

import argparse
import ast
import json
import random
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import cosmic_ray.plugins
from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code

Span = tuple[tuple[int, int], tuple[int, int]]  # from, to: line, column
Site = tuple[str, str, Span]  # file, kind, where
Chosen = tuple[str, int]  # operator, occurrence
DELETION = "delete-statement"
DELETED = (ast.Expr, ast.AugAssign, ast.If, ast.For, ast.Raise, ast.Continue, ast.Break)
SAME = re.compile(r"Operator_(Eq_Is|NotEq_IsNot|Is_Eq|IsNot_NotEq)$")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--count", type=int, required=True)
    parser.add_argument("files", nargs="+")
    given = parser.parse_args()
    json.dump(list(sample(given.files, given.seed, given.count)), sys.stdout)


def sample(files: list[str], seed: int, count: int) -> Iterator[dict[str, object]]:
    """At most `count` mutants, each of another place, in an order that the seed fixes."""
    chance = random.Random(seed)
    sites = {
        site: found
        for file in files
        for site, found in places(file, Path(file).read_text()).items()
    }
    order = sorted(sites)
    chance.shuffle(order)
    for file, kind, span in order:
        if not count:
            return
        operator, occurrence = chance.choice(sites[file, kind, span])
        text = Path(file).read_text()
        mutated = _mutated(text, operator, occurrence)
        if mutated not in (None, text) and _compiles(mutated):
            count -= 1
            yield {"file": file, "line": span[0][0], "operator": operator, "text": mutated}


def places(file: str, text: str) -> dict[Site, list[Chosen]]:
    """Every place of a file that can be mutated, with all that can be done there."""
    found: dict[Site, list[Chosen]] = {}
    silent = list(_silent(ast.parse(text)))
    nodes = list(ast_nodes(get_ast(text)))
    for name in sorted(cosmic_ray.plugins.operator_names()):
        operator = cosmic_ray.plugins.get_operator(name)
        if operator.arguments() or SAME.search(name):
            continue
        made = operator()
        spans = [span for node in nodes for span in made.mutation_positions(node)]
        for occurrence, span in enumerate(spans):
            if not any(first <= span[0] and span[1] <= last for first, last in silent):
                found.setdefault((file, name.split("Operator_")[0], span), []).append(
                    (name, occurrence)
                )
    for occurrence, statement in enumerate(_statements(text)):
        found[file, DELETION, _span(statement)] = [(DELETION, occurrence)]
    return found


def _silent(tree: ast.Module) -> Iterator[Span]:
    """Annotations, and decorators of classes."""
    for node in ast.walk(tree):
        for part in (getattr(node, "annotation", None), getattr(node, "returns", None)):
            if isinstance(part, ast.expr):
                yield _span(part)
        if isinstance(node, ast.ClassDef):
            for each in node.decorator_list:
                yield (
                    (each.lineno, each.col_offset - 1),
                    (each.end_lineno or 0, each.end_col_offset or 0),
                )
        if isinstance(node, ast.Subscript):  # list[int] and its like
            yield _span(node.slice) if _is_type(node) else ((0, 0), (0, 0))


def _is_type(node: ast.Subscript) -> bool:
    return isinstance(node.value, ast.Name) and (
        node.value.id in ("dict", "list", "set") or node.value.id.istitle()
    )


def _statements(text: str) -> list[ast.stmt]:
    """The statements that are deleted one by one; docstrings are none."""
    found = (node for node in ast.walk(ast.parse(text)) if isinstance(node, DELETED))
    docs = lambda node: isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)  # noqa: E731
    return [node for node in found if not docs(node)]


def _span(node: ast.expr | ast.stmt) -> Span:
    return (node.lineno, node.col_offset), (node.end_lineno or 0, node.end_col_offset or 0)


def _mutated(text: str, operator: str, occurrence: int) -> str | None:
    if operator != DELETION:
        return mutate_code(text, cosmic_ray.plugins.get_operator(operator)(), occurrence)
    (first, start), (last, end) = _span(_statements(text)[occurrence])
    lines = text.splitlines(keepends=True)
    head, tail = lines[first - 1][:start], lines[last - 1].encode()[end:].decode()
    return "".join([*lines[: first - 1], f"{head}pass{tail}", *lines[last:]])


def _compiles(text: str) -> bool:
    try:
        compile(text, "mutant", "exec")
    except (SyntaxError, ValueError):
        return False
    return True


if __name__ == "__main__":
    main()
