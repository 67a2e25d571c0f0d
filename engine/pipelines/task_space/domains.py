"""The planning domain of a net: the domain beside the contact model with its processes, and generated operators for the rest.

The text of the domain file is kept; only operators that are no processes go, and lines are added to its sections. Operators of
devices that are no processes are listed under `without`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.model.task_space import Net
from cellwright.engine.pipelines.task_space.operators import OperatorText, operators, setting, written
from cellwright.engine.pipelines.task_space.vocabulary import Vocabulary, whole
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.files import File, read_file
from cellwright.kb.loader.tree import Node, read_tree
from cellwright.kb.model.contacts import ConditionKind, ContactModel
from cellwright.kb.model.domain import Domain, Operator
from cellwright.kb.model.octuples import Octuple, variable

LISTS = ("defaults", "deductive_operators", "without")
SECTIONS = (
    "types",
    "functions",
    "objects",
    "statics",
    "fluents",
    "defaults",
    "operators",
    "deductive_operators",
    "without",
)
Lines = dict[str, list[str]]


def domain_file(model: ContactModel, net: Net, domain: Domain) -> File:
    """The generated domain as a file of the same name. Raises `InvalidInput` if lines cannot be added to a section."""
    vocabulary = Vocabulary(model, domain)
    lines: Lines = {each: [] for each in SECTIONS} | vocabulary.declarations()
    lines["fluents"] = [
        *lines["fluents"],
        "contact(anchor_point, anchor_point): {}",
        "void(anchor_point): {}",
    ]
    lines["operators"] = [line for each in _unique(operators(net, vocabulary)) for line in each.lines]
    _joints(model, lines)
    _gauges(model, lines)
    lines["deductive_operators"] += _deduction(model, vocabulary)
    lines["defaults"] += [*_start(model, vocabulary), "void(Anchor)"]
    lines["without"] = [each.name for each in domain.operators if _is_dropped_device(each, model)]
    file = read_file(Path(domain.path))
    return File.of(file.path, _Edited(file, model.processes).text(lines))


def _is_dropped_device(operator: Operator, model: ContactModel) -> bool:
    """Whether an operator comes from a device, so that it is not in the text, and is no process."""
    return operator.where.used is not None and operator.name not in model.processes


def _unique(found: Iterator[OperatorText]) -> Iterator[OperatorText]:
    """Operators that differ in more than their names."""
    seen: set[tuple[str, ...]] = set()
    for each in found:
        content = (
            *map(str, sorted(each.variables.items())),
            *sorted(each.preconditions),
            *each.adds,
            *each.deletes,
        )
        if content not in seen:
            seen.add(content)
            yield each


def _joints(model: ContactModel, lines: Lines) -> None:
    """Fluents and defaults of the joints that the domain does not know."""
    own = [joint for joint in model.permanent.values() if joint.settings and joint.fact is None]
    for joint in own:
        settings = ", ".join(f"{joint.name}_{each}" for each in joint.settings)
        lines["types"].append(f"{joint.name}_setting: [{settings}]")
        lines["defaults"].append(setting(joint, joint.starts))
    if own:
        lines["types"].append(f"joint: [{', '.join(f'{joint.name}_joint' for joint in own)}]")
        lines["fluents"].append("setting(joint, object): {}")


def _gauges(model: ContactModel, lines: Lines) -> None:
    """What sensors and clocks can read. Plans do not depend on it: the executive reads it when a step begins."""
    looked_at = [each for each in model.restrictions if each.kind is not ConditionKind.JOINT]
    if not looked_at:
        return
    values: dict[str, list[str]] = {}
    for each in looked_at:
        values.setdefault(each.subject, []).append(f"{each.subject}_{each.value}")
    for subject, found in values.items():
        lines["types"].append(f"{subject}_reading: [{', '.join(dict.fromkeys(found))}]")
    lines["types"].append(f"gauge: [{', '.join(f'{subject}_gauge' for subject in values)}]")
    lines["statics"].append("gauge_reads(gauge, object): {}")


def _start(model: ContactModel, vocabulary: Vocabulary) -> Iterator[str]:
    for each in model.initial:
        yield f"contact({vocabulary.point(each.first, {})}, {vocabulary.point(each.second, {})})"


def _deduction(model: ContactModel, vocabulary: Vocabulary) -> Iterator[str]:
    """What contacts say of their anchor points, and what they mean in the domain."""
    yield "when: contact(Key, Lock)\n  denies: void(Key); void(Lock)"
    for meaning in model.meanings:
        for contact in _contacts(model, meaning.contact):
            term = f"contact({vocabulary.point(contact.first, {})}, {vocabulary.point(contact.second, {})})"
            terms = {
                each.instance: vocabulary.object(each, {})
                for each in (contact.first, contact.second)
                if variable(each.instance)
            }
            made = [written(atom, terms) for atom in meaning.made]
            broken = [written(atom, terms) for atom in meaning.broken]
            if made:
                yield f'when: {term}\n  implies: "{"; ".join(made)}"'
            if broken:
                yield f'when: not {term}\n  implies: "{"; ".join(broken)}"'
            yield from (f"when: {each}\n  implies: {term}" for each in made)


def _contacts(model: ContactModel, template: Octuple) -> Iterator[Octuple]:
    """The template for each pair of classes that it describes."""
    for first in whole(template.first, model):
        for second in whole(template.second, model):
            yield Octuple(first, second)


@dataclass
class _Edited:
    """The text of a domain file with sections shortened and lengthened."""

    file: File
    processes: tuple[str, ...]

    def text(self, lines: Lines) -> str:
        """The file with these lines in its sections."""
        root, _ = read_tree(self.file)
        edits: list[tuple[int, int, str]] = []
        keys = [key for key, _ in root.value.values()]
        for name, added in lines.items():
            if not added:
                continue
            if name in root.value:
                key, value = root.value[name]
                end = min(
                    (each.start for each in keys if each.start > key.start), default=len(self.file.text)
                )
                edits += self._section(name, key, value, end, added)
            else:
                end = len(self.file.text)
                edits.append((end, end, f"{name}:\n{_written(name, added, 2)}"))
        text = self.file.text
        for start, end, new in sorted(edits, key=lambda each: each[:2], reverse=True):
            text = text[:start] + new + text[end:]
        return text

    def _section(
        self, name: str, key: Node, value: Node, end: int, added: list[str]
    ) -> Iterator[tuple[int, int, str]]:
        text, indent = self.file.text, 2
        entries: list[Node] = []
        if isinstance(value.value, dict):
            entries = [each for each, _ in value.value.values()]
        elif isinstance(value.value, list):
            entries = list(value.value)
        if entries:
            if text[value.start] in "{[":
                hint = "write the section in several lines, one entry a line"
                message = f"generated lines cannot be added to '{name}'"
                raise InvalidInput([Diagnostic(key.where, "K713", message, hint)])
            column = entries[0].where.column - 1
            indent = column - 2 if name in LISTS else column
        if name == "operators":
            yield from self._dropped(value, end)
        lead = "" if text[:end].endswith("\n") else "\n"
        yield end, end, lead + _written(name, added, max(indent, 0 if name in LISTS else 1)) + "\n"

    def _dropped(self, value: Node, end: int) -> Iterator[tuple[int, int, str]]:
        """The operators that are no processes."""
        keys = [key for key, _ in value.value.values()] if isinstance(value.value, dict) else []
        starts = [key.start - key.where.column + 1 for key in keys]
        for key, start, after in zip(keys, starts, [*starts[1:], end], strict=True):
            if str(key.value).partition("(")[0] not in self.processes:
                yield start, after, ""


def _written(name: str, lines: list[str], indent: int) -> str:
    space = " " * indent
    if name in LISTS:
        parts = (f"{space}- " + line.replace("\n", f"\n{space}") for line in lines)
    else:
        parts = (space + line for line in lines)
    return "\n".join(parts) + "\n"
