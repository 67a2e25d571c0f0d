"""Which tests can notice a mutant, and what of a module it changes. Nothing here runs a test.

A test that never reaches the statement that a mutant changes behaves with the mutant as it does
without it: it need not run.
"""

import ast
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import CodeType, FrameType
from typing import Any

Lines = Mapping[str, frozenset[int]]  # of each file, those that were reached
Trace = Callable[[FrameType, str, Any], Any]
Function = ast.FunctionDef | ast.AsyncFunctionDef
LEAVE = frozenset(
    ("os.exec", "os.fork", "os.forkpty", "os.posix_spawn", "os.system", "subprocess.Popen")
)


@dataclass(frozen=True)
class Measured:
    """A test, the processor time that it takes, and what it reaches; None: it may reach all,
    since it starts processes.
    """

    name: str
    seconds: float
    lines: Lines | None

    def reaches(self, file: str, lines: range) -> bool:
        """Whether any of these lines runs in this test."""
        return self.lines is None or not self.lines[file].isdisjoint(lines)


class Tracer:
    """Notes the lines of these files that run between `on` and `off`, in each thread that
    begins in between.
    """

    def __init__(self, files: Iterable[str]) -> None:
        self._seen: dict[str, set[int]] = {file: set() for file in files}
        self._local = {file: _noting(lines) for file, lines in self._seen.items()}
        self._left = False

    def on(self) -> None:
        """Begin, for good if it is another process that ends with its test."""
        sys.settrace(self._called)
        threading.settrace(self._called)

    def off(self) -> None:
        """End."""
        sys.settrace(None)
        threading.settrace(None)

    def watch_processes(self) -> None:
        """Note as well whether another process is started, which is not followed.

        There is no way to end this.
        """
        sys.addaudithook(self._audited)

    def lines(self) -> Lines | None:
        """What was reached; None if another process may have reached more."""
        return (
            None if self._left else {file: frozenset(lines) for file, lines in self._seen.items()}
        )

    def _called(self, frame: FrameType, _event: str, _value: Any) -> Trace | None:
        return self._local.get(frame.f_code.co_filename)

    def _audited(self, event: str, _values: Any) -> None:
        self._left |= event in LEAVE


def _noting(lines: set[int]) -> Trace:
    def noted(frame: FrameType, _event: str, _value: Any) -> Trace:
        lines.add(frame.f_lineno)
        return noted

    return noted


def chosen(tests: Iterable[Measured], file: str, lines: range) -> list[Measured]:
    """The tests that reach one of these lines, the cheapest first."""
    return sorted(
        (each for each in tests if each.reaches(file, lines)),
        key=lambda each: (each.seconds, each.name),
    )


def statement(text: str, line: int) -> range:
    """The lines of the innermost statement that has this line, with all that lies in it; else,
    of a decorator, all lines.
    """
    found = [each for each in ast.walk(ast.parse(text)) if isinstance(each, ast.stmt)]
    spans = [range(each.lineno, (each.end_lineno or each.lineno) + 1) for each in found]
    return min((span for span in spans if line in span), key=len, default=range(1, len(text) + 1))


def replaced(original: str, mutated: str, file: str) -> tuple[CodeType, CodeType] | None:
    """The code of the function in whose body alone two texts of a file differ, before and after.

    Functions in functions belong to the outer one. None if the texts differ elsewhere, too: then
    the module has to be imported to see the difference.
    """
    before, after = ast.parse(original), ast.parse(mutated)
    pairs = list(zip(outermost(before), outermost(after), strict=False))
    changed = [pair for pair in pairs if _body(pair[0]) != _body(pair[1])]
    places = [(one.name, _first(one), other.name, _first(other)) for one, other in changed]
    for one, other in pairs:
        one.body, other.body = [ast.Pass()], [ast.Pass()]
    if len(places) != 1 or ast.dump(before) != ast.dump(after):
        return None
    name, line, new_name, new_line = places[0]
    old, new = _code(original, file, name, line), _code(mutated, file, new_name, new_line)
    return (old, new) if old.co_freevars == new.co_freevars else None


def outermost(tree: ast.AST) -> Iterator[Function]:
    """The functions and methods that lie in no other."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, Function):
            yield node
        elif isinstance(node, ast.stmt):
            yield from outermost(node)


def _body(function: Function) -> list[str]:
    return [ast.dump(each) for each in function.body]


def _first(function: Function) -> int:
    """Its first line, as its code tells it: that of its first decorator."""
    return min((each.lineno for each in function.decorator_list), default=function.lineno)


def _code(text: str, file: str, name: str, line: int) -> CodeType:
    with warnings.catch_warnings():  # of code that nobody would write, such as `is not "text"`
        warnings.simplefilter("ignore")
        found = _codes(compile(text, file, "exec", dont_inherit=True))
    return next(each for each in found if (each.co_name, each.co_firstlineno) == (name, line))


def _codes(code: CodeType) -> Iterator[CodeType]:
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield each
            yield from _codes(each)
