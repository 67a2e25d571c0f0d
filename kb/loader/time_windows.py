"""Reads `windows:` and `calendars:` of domain and problem files.

A window is one line, `at most 10 min from stopped(P) to start of read(P)`, or a mapping with the
line under `keep`, the objects it is about under `for`, and a `price`.
"""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Never

from cellwright.kb.diagnostics import Source, unknown_name
from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.loader.symbol_table import SymbolTable
from cellwright.kb.loader.variable_types import Typing
from cellwright.kb.loader.yaml_tree import YamlNode
from cellwright.kb.model.domain_model import Kind, Operator, Predicate
from cellwright.kb.model.time_windows import (
    PLAN,
    EventKind,
    EventPattern,
    Side,
    TimeOfWork,
    TimeWindow,
)
from cellwright.kb.syntax import ExpressionError, parse_expression, unit_seconds
from cellwright.kb.terms import ANYTHING, Atom, Function, Number, Term, Variable, term_variables

NUMBER = r"[0-9]+(?:\.[0-9]+)?"
AMOUNT = rf"(?P<{{0}}>{NUMBER})\s*(?P<{{0}}_unit>[a-z]*)(?P<{{0}}_more>(?:\s+{NUMBER}\s*[a-z]+)*)"
LIMITS = tuple(
    re.compile(form)
    for form in (
        rf"at\s+most\s+{AMOUNT.format('most')}",
        rf"at\s+least\s+{AMOUNT.format('least')}"
        rf"(?:\s*(?:,|\band\b)?\s*at\s+most\s+{AMOUNT.format('most')})?",
        rf"exactly\s+{AMOUNT.format('least')}(?:\s*,?\s*up\s+to\s+{AMOUNT.format('most')})?",
    )
)
EVENT = re.compile(r"(?:(start|end)\s+of\s+)?(?:(not|step)\s+)?")
PRICED = re.compile(r",\s*price\s+([0-9]+)\s*$")
WINDOW_HINT = "write `at most 10 min from stopped(P) to read(P)`; or `at least`, or `exactly 60 min, up to 63`"
EVENT_HINT = "write an event, a fluent or `step` and an operator; or `start of plan`, `end of plan`"
CALENDAR_HINT = "write `8 h to 17 h`, or several such, with commas between"
SPAN = re.compile(rf"\s*{AMOUNT.format('first')}\s+to\s+{AMOUNT.format('last')}\s*")
CLOCK = re.compile(r"([0-9]{1,2}):([0-9]{2})")
EVENT_KINDS = {Kind.EVENT: EventKind.EVENT, Kind.FLUENT: EventKind.FACT}


class _Wrong(Exception):
    """A window that cannot be read; it has been reported."""


@dataclass(frozen=True)
class TimeReader:
    """Reads the windows and calendars of one file."""

    reader: Reader
    names: SymbolTable
    operators: Mapping[str, Operator]

    def windows(self) -> Iterator[TimeWindow]:
        """The windows that can be read; all others are reported."""
        for node in self.reader.items("windows"):
            try:
                yield self._window(node)
            except _Wrong:
                continue

    def _window(self, node: YamlNode) -> TimeWindow:
        entry = node.value if isinstance(node.value, dict) else {}
        line = entry["keep"][1] if "keep" in entry else node
        text = str(line.value)
        price = int(entry["price"][1].value) if "price" in entry else None
        if (priced := PRICED.search(text)) is not None:
            price, text = int(priced[1]), text[: priced.start()]
        limits, first, second = self._parts(line, text)
        least, most = self._limits(line, text, limits)
        window = TimeWindow(
            self._event(line, text, first, Side.END),
            self._event(line, text, second, Side.START),
            least,
            most,
            price,
            where=node.where,
        )
        self._require_order(window, line)
        self._note_types(window, line)
        return replace(window, among=tuple(self._among(window, entry)))

    def _parts(
        self, node: YamlNode, text: str
    ) -> tuple[tuple[int, int], tuple[int, int], tuple[int, int]]:
        """Where the limits, the earlier and the later event stand."""
        words = [
            match for match in re.finditer(r"[a-z]+", text) if not _inside(text, match.start())
        ]
        begin = next((word for word in words if word[0] == "from"), None)
        after = (w for w in words if begin and w.start() > begin.start() and w[0] == "to")
        end = next(after, None)
        if begin is None or end is None:
            self._refuse(node, 0, "this is no window of time", WINDOW_HINT)
        return (0, begin.start()), (begin.end(), end.start()), (end.end(), len(text))

    def _limits(
        self, node: YamlNode, text: str, at: tuple[int, int]
    ) -> tuple[int | None, int | None]:
        said = text[at[0] : at[1]].strip()
        match = next((m for form in LIMITS if (m := form.fullmatch(said)) is not None), None)
        if match is None:
            self._refuse(node, 0, f"'{said[:60]}' says no time", WINDOW_HINT)
        given = {name: value for name, value in match.groupdict().items() if value is not None}
        least = self._amount(node, given, "least", "") if "least" in given else None
        most = (
            self._amount(node, given, "most", given.get("least_unit", ""))
            if "most" in given
            else None
        )
        if said.startswith("exactly") and most is None:
            most = least
        return least, most

    def _amount(self, node: YamlNode, given: Mapping[str, str], name: str, default: str) -> int:
        """A time in the domain's unit; without a unit it has that of the other limit."""
        unit = given.get(f"{name}_unit") or default or self.reader.time_unit
        pieces = re.findall(rf"({NUMBER})\s*([a-z]+)", given.get(f"{name}_more", ""))
        return sum(self._piece(node, *piece) for piece in [(given[name], unit), *pieces])

    def _piece(self, node: YamlNode, number: str, unit: str) -> int:
        if unit_seconds(unit) is None:
            self._refuse(node, 0, f"'{unit}' is no unit of time", "ms, s, min and h are units")
        value = self._parse("term", node, f"{number} {unit}", 0).value
        if not isinstance(value, Number):
            self._refuse(node, 0, f"'{number}' is no time", WINDOW_HINT)
        return value.value

    def _event(self, node: YamlNode, text: str, at: tuple[int, int], side: Side) -> EventPattern:
        begin = at[0] + len(text[at[0] : at[1]]) - len(text[at[0] : at[1]].lstrip())
        match = EVENT.match(text, begin, at[1])
        assert match is not None  # all of it may be missing
        said = Side(match[1]) if match[1] else None
        expression = self._parse("atom", node, text[match.end() : at[1]], match.end())
        atom = expression.value
        if atom == PLAN and said is not None and not match[2]:
            return EventPattern(EventKind.PLAN, PLAN, said)
        kind, pattern = self._known(expression, atom, match[2] or "")
        if kind in (EventKind.FACT, EventKind.ENDING):
            return EventPattern(kind, pattern, said or Side.END)
        return EventPattern(kind, pattern, said or side)

    def _known(self, expression: Expression, atom: Atom, word: str) -> tuple[EventKind, Atom]:
        """What an atom names; arguments that it leaves out may be anything."""
        predicate, operator = self.names.predicates.get(atom.name), self.operators.get(atom.name)
        if word != "step" and predicate is not None:
            if predicate.kind not in EVENT_KINDS or (word and predicate.kind is Kind.EVENT):
                wanted = (Kind.FLUENT,) if word else tuple(EVENT_KINDS)
                self.names.predicate(_fill_atom(atom, len(predicate.arguments)), expression, wanted)
                raise _Wrong
            kind = EventKind.ENDING if word == "not" else EVENT_KINDS[predicate.kind]
            return kind, self._typed(expression, atom, predicate)
        if operator is None or word == "not":
            known = [*self.names.predicates, *self.operators, str(PLAN)]
            unknown = unknown_name("event", atom.name, known, expression.place(atom))
            self.names.findings.note(replace(unknown, hint=unknown.hint or EVENT_HINT))
            raise _Wrong
        return EventKind.STEP, self._typed(expression, atom, _as_predicate(operator))

    def _typed(self, expression: Expression, atom: Atom, predicate: Predicate) -> Atom:
        count = len(predicate.arguments)
        if len(atom.arguments) > count:
            hint = f"it is {predicate.name}({', '.join(predicate.arguments)})"
            message = f"{atom.name} takes {count} arguments at most, not {len(atom.arguments)}"
            self.names.findings.add(expression.place(atom), "K102", message, hint)
            raise _Wrong
        filled = _fill_atom(atom, count)
        before = len(self.names.findings.diagnostics)
        typing = Typing(self.names)
        for argument, type_ in zip(filled.arguments, predicate.arguments, strict=True):
            typing.term(argument, type_, expression, filled)
        if any(not each.warning for each in self.names.findings.diagnostics[before:]):
            raise _Wrong
        return filled

    def _require_order(self, window: TimeWindow, node: YamlNode) -> None:
        if window.earlier == EventPattern(EventKind.PLAN, PLAN, Side.END) or (
            window.later == EventPattern(EventKind.PLAN, PLAN, Side.START)
        ):
            self._refuse(
                node,
                0,
                "nothing comes after the end of the plan, or before its start",
                "a window leads from the start of the plan, or to its end",
                "K321",
            )
        if window.least is not None and window.most is not None and window.most < window.least:
            message = f"no time is at least {window.least} and at most {window.most}"
            self._refuse(node, 0, message, "the smaller time comes first", "K321")

    def _note_types(self, window: TimeWindow, node: YamlNode) -> None:
        """Point out a variable that only one event has, where `_` would do."""
        if EventKind.PLAN in (window.earlier.kind, window.later.kind):
            return
        one, other = (
            set(term_variables(pattern.atom)) - {ANYTHING}
            for pattern in (window.earlier, window.later)
        )
        for variable in sorted(one ^ other, key=str):
            message = f"only one of both events has {variable}, so it may be anything"
            self.names.findings.add(node.where, "K110", message, "write _ for it", warning=True)

    def _among(
        self, window: TimeWindow, entry: Mapping[str, tuple[YamlNode, YamlNode]]
    ) -> Iterator[tuple[Variable, tuple[Term, ...]]]:
        listed = entry["for"][1].value if "for" in entry else {}
        own = {*term_variables(window.earlier.atom), *term_variables(window.later.atom)}
        for name, (key, node) in listed.items():
            if Variable(name) not in own:
                hint = "name it in both events, such as stopped(P)"
                message = f"no event of this window has the variable {name}"
                self.names.findings.add(key.where, "K105", message, hint)
            values = [item for item, _ in self.reader.once(self.reader.names(node))]
            for value in values:
                if value not in self.names.objects:
                    unknown = unknown_name("object", value, self.names.objects, node.where)
                    self.names.findings.note(unknown)
            yield Variable(name), tuple(map(Function, values))

    def _parse(self, start: str, node: YamlNode, text: str, offset: int) -> Expression:
        try:
            parsed = parse_expression(start, text, self.reader.time_unit)
        except ExpressionError as error:
            self._refuse(node, offset + error.offset, error.message, error.hint, error.code)
        return Expression(parsed.value, parsed, _Shifted(node, offset))  # type: ignore[arg-type]

    def _refuse(
        self, node: YamlNode, offset: int, message: str, hint: str, code: str = "K107"
    ) -> Never:
        self.names.findings.add(node.place(offset), code, message, hint)
        raise _Wrong

    # calendars

    def calendars(self) -> Iterator[TimeOfWork]:
        """The calendars that can be read; all others are reported."""
        for node in self.reader.items("calendars"):
            try:
                yield self._calendar(node)
            except _Wrong:
                continue

    def _calendar(self, node: YamlNode) -> TimeOfWork:
        entry = {key: value for key, (_, value) in node.value.items()}
        period = self._time(entry["every"]) if "every" in entry else None
        begins = self._time(entry["begins"]) if "begins" in entry else 0
        is_open = "open" in entry
        if is_open == ("closed" in entry):
            self._refuse(
                node,
                0,
                "a calendar says when something is open, or when it is closed",
                "give one of both",
                "K005",
            )
        written = entry["open" if is_open else "closed"]
        spans = self._spans(written, period)
        of, is_step = self._subject(entry["of"])
        if period is not None and (period <= 0 or any(last > period for _, last in spans)):
            self._refuse(
                written,
                0,
                "a span lies outside the time after which it comes again",
                "make `every` longer, or the span shorter",
                "K322",
            )
        if not is_open:
            spans = _complement(spans, period)
        if begins:
            spans = _later(spans, -begins, period)
        if not spans:
            self._refuse(written, 0, "this calendar leaves no time", "leave some time open", "K322")
        starts = "starts" in entry and entry["starts"].value == "true"
        return TimeOfWork(of, is_step, spans, period, starts, node.where)

    def _subject(self, node: YamlNode) -> tuple[Function, bool]:
        expression = self._parse("atom", node, str(node.value), 0)
        operator = self.operators.get(expression.value.name)
        if operator is not None:
            return self._typed(expression, expression.value, _as_predicate(operator)), True
        return expression.value, False

    def _spans(self, node: YamlNode, period: int | None) -> tuple[tuple[int, int], ...]:
        """The spans in their order; one that begins late and ends early goes on in the next
        period.
        """
        spans = list[tuple[int, int]]()
        for part in str(node.value).split(","):
            match = SPAN.fullmatch(_clock_as_minutes(part))
            if match is None:
                self._refuse(node, 0, f"'{part.strip()[:40]}' is no span of time", CALENDAR_HINT)
            given = {name: value for name, value in match.groupdict().items() if value}
            last = self._amount(node, given, "last", "")
            first = self._amount(node, given, "first", given.get("last_unit", ""))
            if first > last and period is not None and first < period:
                spans += [(first, period), (0, last)]
                continue
            if first >= last:
                self._refuse(
                    node,
                    0,
                    f"the span '{part.strip()[:40]}' has no time in it",
                    "the earlier time comes first",
                    "K322",
                )
            spans.append((first, last))
        return _united_spans(spans)

    def _time(self, node: YamlNode) -> int:
        match = re.fullmatch(AMOUNT.format("least"), _clock_as_minutes(str(node.value)).strip())
        if match is None:
            self._refuse(node, 0, f"'{str(node.value)[:40]}' is no time", "write 2 h, or 7:30")
        return self._amount(node, {k: v for k, v in match.groupdict().items() if v}, "least", "")


@dataclass(frozen=True)
class _Shifted:
    """A part of a scalar, whose places are those of the scalar."""

    node: YamlNode
    offset: int

    @property
    def where(self) -> Source:
        return self.node.place(self.offset)

    def place(self, offset: int) -> Source:
        """The place of a character of the part."""
        return self.node.place(self.offset + offset)


def _inside(text: str, offset: int) -> bool:
    """Whether a character stands within brackets or a quoted text."""
    before = re.sub(r'"(\\.|[^"\\])*"', lambda match: " " * len(match[0]), text[:offset])
    return before.count("(") > before.count(")") or '"' in before


def _fill_atom(atom: Atom, count: int) -> Atom:
    return Function(atom.name, (*atom.arguments, *[ANYTHING] * (count - len(atom.arguments))))


def _as_predicate(operator: Operator) -> Predicate:
    types = tuple(parameter.type for parameter in operator.parameters)
    return Predicate(operator.name, types, Kind.EVENT, None, operator.where)


def _clock_as_minutes(text: str) -> str:
    """Times of the day as minutes: 7:30 is 450 min."""
    return CLOCK.sub(lambda match: f"{60 * int(match[1]) + int(match[2])} min", text)


def _united_spans(spans: Iterable[tuple[int, int]]) -> tuple[tuple[int, int], ...]:
    """Spans in their order; those that overlap or touch become one."""
    united = list[tuple[int, int]]()
    for first, last in sorted(spans):
        if united and first <= united[-1][1]:
            united[-1] = united[-1][0], max(last, united[-1][1])
        else:
            united.append((first, last))
    return tuple(united)


FAR = (1 << 31) - 1  # the latest time that can be written


def _complement(
    spans: Iterable[tuple[int, int]], period: int | None
) -> tuple[tuple[int, int], ...]:
    """The times that lie in no span."""
    free, now = list[tuple[int, int]](), 0
    for first, last in spans:
        if first > now:
            free.append((now, first))
        now = max(now, last)
    end = FAR if period is None else period
    return (*free, (now, end)) if now < end else tuple(free)


def _later(
    spans: Iterable[tuple[int, int]], shift: int, period: int | None
) -> tuple[tuple[int, int], ...]:
    """Spans that come by so much later, within the period if there is one."""
    moved = []
    for first, last in spans:
        if period is None:
            moved.append((max(0, first + shift), last + shift))
            continue
        begin = (first + shift) % period
        end = begin + last - first
        moved += [(begin, min(end, period))] + ([(0, end - period)] if end > period else [])
    return _united_spans((first, last) for first, last in moved if first < last)
