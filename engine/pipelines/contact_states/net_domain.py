"""Writes the planning domain of a net: given sections, and generated operators for the rest.

The text of the domain file is kept; only operators that are no processes go, and lines are added to
its sections. Operators of devices that are no processes are listed under `without`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cellwright.engine.model.task_space import ContactNet
from cellwright.engine.pipelines.contact_states.net_operators import (
    NetVocabulary,
    OperatorText,
    atom_with_terms,
    joint_setting_fact,
    net_operators,
    object_templates,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput
from cellwright.kb.files import File, read_file
from cellwright.kb.loader.yaml_tree import YamlNode, read_tree
from cellwright.kb.model.contact_model import ConditionKind, ContactModel, Octuple, is_variable_name
from cellwright.kb.model.domain_model import Domain, Operator

LIST_SECTIONS = ("defaults", "deductive_operators", "without")
DOMAIN_SECTIONS = (
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


def generated_domain_file(model: ContactModel, net: ContactNet, domain: Domain) -> File:
    """The generated domain as a file of the same name.

    Raises `InvalidInput` if lines cannot be added to a section.
    """
    vocabulary = NetVocabulary(model, domain)
    lines: Lines = {section: [] for section in DOMAIN_SECTIONS} | vocabulary.declarations()
    lines["fluents"] = [
        *lines["fluents"],
        "contact(anchor_point, anchor_point): {}",
        "void(anchor_point): {}",
    ]
    lines["operators"] = [
        line
        for operator_text in _unique_operators(net_operators(net, vocabulary))
        for line in operator_text.lines
    ]
    _add_joints(model, lines)
    _add_gauges(model, lines)
    lines["deductive_operators"] += _deduction_lines(model, vocabulary)
    lines["defaults"] += [*_start_lines(model, vocabulary), "void(Anchor)"]
    lines["without"] = [
        operator.name for operator in domain.operators if _is_dropped_device(operator, model)
    ]
    file = read_file(Path(domain.path))
    return File.of(file.path, _EditedDomain(file, model.processes).text(lines))


def _is_dropped_device(operator: Operator, model: ContactModel) -> bool:
    """Whether an operator comes from a device, so that it is not in the text, and is no process."""
    return operator.where.used is not None and operator.name not in model.processes


def _unique_operators(operators_found: Iterator[OperatorText]) -> Iterator[OperatorText]:
    """Operators that differ in more than their names."""
    seen: set[tuple[str, ...]] = set()
    for operator_text in operators_found:
        content = (
            *map(str, sorted(operator_text.variables.items())),
            *sorted(operator_text.preconditions),
            *operator_text.adds,
            *operator_text.deletes,
        )
        if content not in seen:
            seen.add(content)
            yield operator_text


def _add_joints(model: ContactModel, lines: Lines) -> None:
    """Fluents and defaults of the joints that the domain does not know."""
    own = [joint for joint in model.permanent.values() if joint.settings and joint.fact is None]
    for joint in own:
        settings = ", ".join(f"{joint.name}_{value}" for value in joint.settings)
        lines["types"].append(f"{joint.name}_setting: [{settings}]")
        lines["defaults"].append(joint_setting_fact(joint, joint.starts))
    if own:
        lines["types"].append(f"joint: [{', '.join(f'{joint.name}_joint' for joint in own)}]")
        lines["fluents"].append("setting(joint, object): {}")


def _add_gauges(model: ContactModel, lines: Lines) -> None:
    """What sensors and clocks can read.

    Plans do not depend on it: the executive reads it when a step begins.
    """
    looked_at = [
        restriction
        for restriction in model.restrictions
        if restriction.kind is not ConditionKind.JOINT
    ]
    if not looked_at:
        return
    values: dict[str, list[str]] = {}
    for restriction in looked_at:
        values.setdefault(restriction.subject, []).append(
            f"{restriction.subject}_{restriction.value}"
        )
    for subject, readings in values.items():
        lines["types"].append(f"{subject}_reading: [{', '.join(dict.fromkeys(readings))}]")
    lines["types"].append(f"gauge: [{', '.join(f'{subject}_gauge' for subject in values)}]")
    lines["statics"].append("gauge_reads(gauge, object): {}")


def _start_lines(model: ContactModel, vocabulary: NetVocabulary) -> Iterator[str]:
    for contact in model.initial:
        yield (
            f"contact({vocabulary.point(contact.first, {})}, "
            f"{vocabulary.point(contact.second, {})})"
        )


def _deduction_lines(model: ContactModel, vocabulary: NetVocabulary) -> Iterator[str]:
    """What contacts say of their anchor points, and what they mean in the domain."""
    yield "when: contact(Key, Lock)\n  denies: void(Key); void(Lock)"
    for meaning in model.meanings:
        for contact in _class_contacts(model, meaning.contact):
            term = (
                f"contact({vocabulary.point(contact.first, {})}, "
                f"{vocabulary.point(contact.second, {})})"
            )
            terms = {
                point.instance: vocabulary.object(point, {})
                for point in (contact.first, contact.second)
                if is_variable_name(point.instance)
            }
            made_atoms = [atom_with_terms(atom, terms) for atom in meaning.made]
            broken = [atom_with_terms(atom, terms) for atom in meaning.broken]
            if made_atoms:
                yield f'when: {term}\n  implies: "{"; ".join(made_atoms)}"'
            if broken:
                yield f'when: not {term}\n  implies: "{"; ".join(broken)}"'
            yield from (f"when: {made_atom}\n  implies: {term}" for made_atom in made_atoms)


def _class_contacts(model: ContactModel, template: Octuple) -> Iterator[Octuple]:
    """The template for each pair of classes that it describes."""
    for first in object_templates(template.first, model):
        for second in object_templates(template.second, model):
            yield Octuple(first, second)


@dataclass
class _EditedDomain:
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
                    (next_key.start for next_key in keys if next_key.start > key.start),
                    default=len(self.file.text),
                )
                edits += self._section(name, key, value, end, added)
            else:
                end = len(self.file.text)
                edits.append((end, end, f"{name}:\n{_written_section(name, added, 2)}"))
        text = self.file.text
        for start, end, new in sorted(edits, key=lambda edit: edit[:2], reverse=True):
            text = text[:start] + new + text[end:]
        return text

    def _section(
        self, name: str, key: YamlNode, value: YamlNode, end: int, added: list[str]
    ) -> Iterator[tuple[int, int, str]]:
        text, indent = self.file.text, 2
        entries: list[YamlNode] = []
        if isinstance(value.value, dict):
            entries = [entry for entry, _ in value.value.values()]
        elif isinstance(value.value, list):
            entries = list(value.value)
        if entries:
            if text[value.start] in "{[":
                hint = "write the section in several lines, one entry a line"
                message = f"generated lines cannot be added to '{name}'"
                raise InvalidInput([Diagnostic(key.where, "K713", message, hint)])
            column = entries[0].where.column - 1
            indent = column - 2 if name in LIST_SECTIONS else column
        if name == "operators":
            yield from self._dropped(value, end)
        lead = "" if text[:end].endswith("\n") else "\n"
        yield (
            end,
            end,
            lead
            + _written_section(name, added, max(indent, 0 if name in LIST_SECTIONS else 1))
            + "\n",
        )

    def _dropped(self, value: YamlNode, end: int) -> Iterator[tuple[int, int, str]]:
        """The operators that are no processes."""
        keys = [key for key, _ in value.value.values()] if isinstance(value.value, dict) else []
        starts = [key.start - key.where.column + 1 for key in keys]
        for key, start, after in zip(keys, starts, [*starts[1:], end], strict=True):
            if str(key.value).partition("(")[0] not in self.processes:
                yield start, after, ""


def _written_section(name: str, lines: list[str], indent: int) -> str:
    space = " " * indent
    if name in LIST_SECTIONS:
        parts = (f"{space}- " + line.replace("\n", f"\n{space}") for line in lines)
    else:
        parts = (space + line for line in lines)
    return "\n".join(parts) + "\n"
