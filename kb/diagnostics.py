"""Diagnostics: an error, its place, and what to try.

Codes are stable; `docs/diagnostics.md` explains them.
"""

import difflib
import re
import unicodedata
from collections.abc import Collection, Iterable, Set
from dataclasses import dataclass, field

DIAGNOSTIC_CODES = {
    "K001": "the file cannot be read",
    "K002": "not YAML",
    "K003": "duplicate key",
    "K004": "a YAML feature that domain files do not use",
    "K005": "unknown key, missing key or wrong type of value",
    "K006": "a comment swallowed part of an expression",
    "K007": "nested too deeply or too large",
    "K101": "unknown name",
    "K102": "wrong number of arguments",
    "K103": "wrong type",
    "K104": "name declared twice",
    "K105": "unsafe variable",
    "K106": "unbalanced brackets",
    "K107": "syntax error in an expression",
    "K108": "wrong kind of predicate in this place",
    "K109": "recursive type or function",
    "K110": "a variable that occurs only once",
    "K111": "listed twice",
    "K112": "a name that is reserved or not allowed",
    "K113": "a number out of range",
    "K114": "an entry that does nothing",
    "K115": "a duration or cost that cannot be told",
    "K201": "error in an ASP file",
    "K202": "ASP that domain files may not use",
    "K203": "include outside the domain folder or not found",
    "K204": "integrity constraint violated",
    "K301": "contradiction: an atom is both added and denied",
    "K302": "a denied atom triggers a rule, but is no precondition",
    "K304": "operator can never be applied",
    "K305": "operator reads a resource that similar operators hold",
    "K307": "grounding exceeds its limit",
    "K309": "declared, but nothing uses it",
    "K310": "a condition that nothing makes true",
    "K311": "almost what the engine reads by convention",
    "K312": "a rule for a name that nothing reads, but that is almost a declared one",
    "K313": "an initial state from which no goal can be reached",
    "K314": "two things where only one fits",
    "K315": "a fact that is denied and never made true again",
    "K316": "limits that nothing passes, or that contradict each other",
    "K317": "a step without a duration beside others that have one",
    "K318": "a reply with a variable that a condition binds",
    "K319": "a time that cannot be kept",
    "K321": "a window of time that contradicts itself, or that no step is about",
    "K322": "a calendar that leaves no time",
    "K401": "unknown domain, problem or file",
    "K402": "not a plan in the documented format",
    "K403": "existing files are not overwritten",
    "K404": "a target of another kind than the command takes",
    "K405": "the domain lacks what the command needs",
    "K406": "a value that an option does not take",
    "K407": "a command line that cannot be understood",
    "K408": "an option that has no effect",
    "K409": "options that need or exclude each other",
    "K410": "a step that the plan does not have",
    "K411": "a report that contradicts the plan",
    "K412": "a plan for another problem",
    "K413": "a file of another format than expected",
    "K414": "a plug-in or a package that is not installed",
    "K415": "a file that cannot be written",
    "K416": "a library that cannot be used",
    "K417": "a MACROP that the library does not have",
    "K418": "a problem file that cannot be edited",
    "K419": "not enough memory",
    "K420": "not enough time",
    "K421": "a run that cannot be begun or told",
    "K422": "a library that is damaged",
    "K425": "a controller that does not answer",
    "K430": "a cluster that cannot be used",
    "K501": "the plan does not execute",
    "K502": "the plan misses a goal",
    "K503": "unordered steps interfere",
    "K504": "a claimed causal link does not hold",
    "K505": "the plan's orderings have a cycle",
    "K506": "the plan does not follow the workflow",
    "K507": "a step number that is used twice or is not positive",
    "K508": "a claim of a plan that is not so",
    "K509": "a window of time or a calendar that a plan does not keep",
    "K601": "not a phrase pattern",
    "K602": "a command that is not understood",
    "K603": "a command that names nothing, or more than one thing",
    "K604": "an ordered act that cannot be a stage",
    "K605": "a phrase that an earlier phrase covers",
    "K606": "a noun that no sentence can contain",
    "K607": "a noun that means two things",
    "K701": "a frame that is placed relative to itself",
    "K702": "a shape that is empty or contradicts itself",
    "K703": "an error in a robot description",
    "K704": "a region that is not inside its parents",
    "K705": "a place that the arm cannot reach",
    "K706": "a mesh file that is not there",
    "K707": "a wrong number of joint values",
    "K710": "not a contact",
    "K711": "anchor points that do not match",
    "K712": "contacts that cannot be at the start",
    "K713": "a domain that cannot take generated operators",
    "K801": "not PDDL",
    "K802": "a PDDL feature that is not supported",
    "K803": "not a TSPLIB file",
    "K804": "not a QIF file",
    "K805": "not a table of measurements",
    "K806": "not a job shop file",
    "K807": "a feature that is not measured as asked",
    "K808": "distances that rounding makes 0",
    "K811": "not a PNML file",
    "K901": "wrong probabilities",
    "K902": "causes that no test distinguishes and no repair cures together",
    "K903": "a cause that nothing repairs",
    "K904": "a test that distinguishes no causes",
    "K905": "too many causes of one exception",
    "K906": "a step that the exception does not interrupt",
    "K907": "outcomes that contradict each other",
}


@dataclass(frozen=True, slots=True, order=True)
class Source:
    """A place in a file; lines and columns count from 1, `column` 0 means the whole line.

    `text` is that line. For a long line, it is the part around the column, which begins after `cut`
    characters. A place in the file of a device has `used`: the place where the domain uses the
    device.
    """

    path: str
    line: int = 0
    column: int = 0
    text: str = field(default="", compare=False)
    cut: int = field(default=0, compare=False)
    used: "Source | None" = field(default=None, compare=False)

    def __str__(self) -> str:
        path = printable_line(self.path)
        return ":".join([path, *(str(part) for part in (self.line, self.column) if part)])

    def excerpt(self) -> list[str]:
        """The line, and a caret under the column; empty if the text is not known."""
        if not self.text.strip():
            return []
        before = self.text[: self.column - 1 - self.cut]
        shown = ("..." if self.cut else "") + printable_line(self.text)
        if not self.column:
            return [shown]
        margin = "".join(
            "\t" if character == "\t" else " " * _character_width(character)
            for character in printable_line(before)
        )
        return [shown, f"{'   ' if self.cut else ''}{margin}^"]


NOWHERE = Source("")


def printable_line(text: str) -> str:
    """One line of text in which what would command the terminal is shown as `\\u001b`, line
    ends included.
    """
    return escape_controls(text.replace("\n", "\\u000a"))


def escape_controls(text: str) -> str:
    """The text with `\\u001b` for each character that would control the terminal or change the
    direction of the text.

    Ends of lines stay. In JSON the result is the same text.
    """
    if text.isascii() and text.isprintable():
        return text
    # The pattern is compiled at the first use, because most runs report nothing.
    return re.sub(_COMMANDING, lambda match: f"\\u{ord(match[0]):04x}", text)


_COMMANDING = r"[\0-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]|\r(?!\n)"


def _character_width(character: str) -> int:
    """The number of columns that a character takes on a terminal."""
    if unicodedata.combining(character):
        return 0
    return 2 if unicodedata.east_asian_width(character) in "WF" else 1


@dataclass(frozen=True, slots=True, order=True)
class Diagnostic:
    """One finding: its place, stable code, message, and what to try (may be empty).

    A warning does not make a file invalid.
    """

    where: Source
    code: str
    message: str
    hint: str = ""
    warning: bool = False

    def __str__(self) -> str:
        severity = "warning" if self.warning else "error"
        lines = [f"{self.where}: {severity} {self.code}: {printable_line(self.message)}"]
        lines += [f"    {line}" for line in self.where.excerpt()]
        if self.where.used:
            lines.append(f"  used: {self.where.used}")
        if self.hint:
            lines.append(f"  try: {printable_line(self.hint)}")
        return "\n".join(lines)


def order_diagnostics(diagnostics: Iterable[Diagnostic]) -> tuple[Diagnostic, ...]:
    """Each diagnostic once: errors, then warnings; causes before what follows from them; then by
    place.

    A name that is unknown in several places of a file is told once, with the other lines.
    """
    unique = sorted(set(diagnostics))
    unknown: dict[tuple[str, str], list[Diagnostic]] = {}
    for finding in unique:
        if finding.code == "K101":
            unknown.setdefault((finding.where.path, finding.message), []).append(finding)
    firsts = {same[0]: same for same in unknown.values()}
    merged = [
        _with_lines(firsts[diagnostic]) if diagnostic in firsts else diagnostic
        for diagnostic in unique
    ]
    remaining = (
        diagnostic
        for diagnostic, old in zip(merged, unique, strict=True)
        if old.code != "K101" or old in firsts
    )
    return tuple(
        sorted(
            remaining,
            key=lambda diagnostic: (diagnostic.warning, _code_rank(diagnostic.code), diagnostic),
        )
    )


def _with_lines(same: list[Diagnostic]) -> Diagnostic:
    """The first of several diagnostics about one name, with the lines of the others in its hint."""
    first, *others = same
    lines = sorted({diagnostic.where.line for diagnostic in others} - {first.where.line})
    if not lines:
        return first
    shown = ", ".join(map(str, lines[:3])) + (
        f" and {len(lines) - 3} more" if len(lines) > 3 else ""
    )
    also = f"the same in line{'s' if len(lines) > 1 else ''} {shown}"
    return Diagnostic(
        first.where,
        first.code,
        first.message,
        "; ".join(filter(None, [first.hint, also])),
        first.warning,
    )


_CAUSES = (
    "K0",
    "K10[4679]|K112",
    "K101",
    "K31[0-5]",
)  # what other findings may follow from, the deepest cause first


def _code_rank(code: str) -> int:
    return next((rank for rank, codes in enumerate(_CAUSES) if re.match(codes, code)), len(_CAUSES))


class InvalidInput(Exception):
    """The input has errors. The exception carries all diagnostics, the most important first."""

    def __init__(self, diagnostics: Iterable[Diagnostic]) -> None:
        self.diagnostics = order_diagnostics(diagnostics)
        super().__init__("\n".join(map(str, self.diagnostics)))


def nearest_hint(name: str, known: Collection[str]) -> str:
    """The hint "did you mean ...?" for a misspelt name; empty if no known name is similar."""
    near = difflib.get_close_matches(name, sorted(known), n=5)
    best = max(near, key=lambda candidate: candidate[:1] == name[:1], default="")
    return f"did you mean '{best}'?" if best else ""


def suggested_name(hint: str) -> str:
    """The name that a hint of `nearest` suggests; empty if it suggests none."""
    match = re.search(r"did you mean '([^']+)'\?", hint)
    return match[1] if match else ""


def unknown_name(kind: str, name: str, known: Collection[str], where: Source) -> Diagnostic:
    """The diagnostic for a name that is not declared, with the most similar known name or some
    of the known names.
    """
    shown = (sorted(known) if isinstance(known, Set) else list(known))[:8]
    some = ", ".join(shown) + (", ..." if len(known) > len(shown) else "")
    hint = nearest_hint(name, known) or (f"known: {some}" if shown else "declare it first")
    return Diagnostic(where, "K101", f"unknown {kind} '{name[:60]}'", hint)


def select_errors(diagnostics: Iterable[Diagnostic]) -> list[Diagnostic]:
    """The diagnostics that are not warnings."""
    return [diagnostic for diagnostic in diagnostics if not diagnostic.warning]
