"""From a contact model to the net of a cell: filters are found among the plug-ins, and the stage generates the rest."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.engine.model.task_space import Brought, Net, Space
from cellwright.engine.plugins import contact_filter
from cellwright.engine.ports import ContactFilter
from cellwright.engine.stages.states.counting import individuals
from cellwright.engine.stages.states.firing import Player
from cellwright.engine.stages.states.generation import MOST_FORMS, generate
from cellwright.engine.stages.states.nets import net_of
from cellwright.engine.stages.states.sequences import Found
from cellwright.engine.stages.states.sequences import sequence as search
from cellwright.engine.stages.states.tokens import token_types
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.files import File, read_file
from cellwright.kb.loader import domain_of, load, problem_files
from cellwright.kb.loader.contacts import load_contacts
from cellwright.kb.loader.contacts.templates import Templates
from cellwright.kb.loader.reader import Findings, require
from cellwright.kb.loader.tree import Node
from cellwright.kb.model.contacts import ContactModel
from cellwright.kb.model.octuples import Octuple
from cellwright.kb.targets import DEVICES

MOST_PLACES = 5_000  # fully specified; they and their transitions are listed one by one


@dataclass(frozen=True, slots=True)
class Wanted:
    """What is to be generated: the whole cell or only `parts` of it (objects or classes), by class or `full`y specified."""

    parts: tuple[str, ...] = ()
    full: bool = False
    forms: int = MOST_FORMS


def model_of(target: str) -> tuple[ContactModel, tuple[Diagnostic, ...]]:
    """The contact model of the domain that a target names, and warnings. Raises `InvalidInput`."""
    return load_contacts(domain_of(target))


def space_of(model: ContactModel, wanted: Wanted = Wanted()) -> Space:
    """The forms and steps of a cell. Raises `InvalidInput` for unknown parts or filters, or a start that none lets pass."""
    _require_known(model, wanted.parts)
    filters: dict[str, ContactFilter] = {name: contact_filter(name, model) for name in model.filters}
    individuals = {each for one in filters.values() for each in one.individuals()}
    types = token_types(model, wanted.parts, wanted.full, individuals)
    if not types:
        hint = "name objects or classes with anchor points"
        raise InvalidInput(
            [Diagnostic(Source(model.path), "K405", "there is nothing that has anchor points", hint)]
        )
    return generate(model, types, filters, wanted.forms)


def net(model: ContactModel, wanted: Wanted = Wanted()) -> Net:
    """The net of a cell. Raises `InvalidInput` as `space_of` does, and if `full` there are too many places to list."""
    if wanted.full:
        _require_listable(model, wanted)
    return net_of(space_of(model, wanted), wanted.full)


def _require_listable(model: ContactModel, wanted: Wanted) -> None:
    space = space_of(model, replace(wanted, full=False))
    count = sum(individuals(space, form) for form in space.forms)
    if count > MOST_PLACES or not space.complete:
        message = (
            f"{'' if space.complete else 'more than '}{count:,} fully specified places are too many to list"
        )
        hint = "leave --full out: the net by contact class is small, and its states are counted all the same"
        raise InvalidInput([Diagnostic(Source(model.path), "K007", message, hint)])


def sequence(model: ContactModel, goals: Sequence[str], wanted: Wanted = Wanted()) -> tuple[Found, Player]:
    """The shortest sequence of operators to contact states that are written as octuples, and the net in play.

    Raises `InvalidInput`.
    """
    space = space_of(model, wanted)
    player = Player(space, net_of(space))
    return search(player, [_goal(model, each) for each in goals]), player


def _goal(model: ContactModel, text: str) -> Octuple:
    file = File.of("--goal", text)
    findings = Findings()
    found = Templates(findings, model.classes, model.objects).of(Node(text, file, 0, len(text)))
    require(findings)
    assert found is not None, "what is wrong was reported"
    return found


def _require_known(model: ContactModel, parts: Collection[str]) -> None:
    known = [*model.objects, *model.classes]
    wrong = [
        unknown_name("object or class", each, known, Source("--reduced"))
        for each in parts
        if each not in known
    ]
    if wrong:
        raise InvalidInput(wrong)


def brought(model: ContactModel, whole: Net, part: str) -> Brought:
    """The net of a cell compared with the net without an object, or the objects of a class. Raises `InvalidInput`."""
    _require_known(model, [part])
    others = tuple(each for each in model.objects if part not in (each, *model.kinds(each)))
    before = net(model, Wanted(others))
    known = {(each.filter, each.reason) for each in before.removed}
    return Brought(
        part,
        len(whole.places) - len(before.places),
        len(whole.transitions) - len(before.transitions),
        whole.growth.states - before.growth.states,
        tuple(sorted({(each.filter, each.reason) for each in whole.removed} - known)),
    )


def generated(path: Path) -> File:
    """The planning domain that is generated from the contact model beside a domain file. Raises `InvalidInput`."""
    from cellwright.engine.pipelines.task_space.domains import domain_file

    model, _ = load_contacts(path)
    return domain_file(model, net(model), load(path).domain)


def write_domain(target: str, folder: Path) -> tuple[Path, ...]:
    """Write the generated domain into a folder, with its rules, own devices and problems. Returns the files. Raises `InvalidInput`.

    Files that are there are not overwritten.
    """
    path = domain_of(target)
    texts = {Path(path.name): generated(path).text}
    devices = (each for each in (path.parent / DEVICES).rglob("*") if each.is_file())
    for each in sorted((*path.parent.glob("*.lp"), *devices, *problem_files(path))):
        texts[each.relative_to(path.parent)] = read_file(each).text
    there = [folder / name for name in texts if (folder / name).exists()]
    if there:
        message = f"{there[0]} is there already"
        raise InvalidInput([Diagnostic(Source(str(folder)), "K403", message, "name a new folder")])
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, "utf-8")
    return tuple(folder / name for name in texts)
