"""From a contact model to the net of a cell, with contact filters from plug-ins."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cellwright.engine.model.task_space import ContactNet, FormSpace, ObjectShare
from cellwright.engine.plugins import contact_filter
from cellwright.engine.ports import ContactFilter
from cellwright.engine.stages.states.contact_net import net_of
from cellwright.engine.stages.states.global_states import count_individuals
from cellwright.engine.stages.states.net_player import NetPlayer, OperatorSequence
from cellwright.engine.stages.states.net_player import find_sequence as search
from cellwright.engine.stages.states.state_generation import MAX_FORMS, generate_states
from cellwright.engine.stages.states.token_types import token_types
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, unknown_name
from cellwright.kb.files import File, read_file
from cellwright.kb.loader import domain_of, load, problem_files
from cellwright.kb.loader.contacts import ContactTemplates, load_contacts
from cellwright.kb.loader.reader import LoadFindings, require_valid
from cellwright.kb.loader.yaml_tree import YamlNode
from cellwright.kb.model.contact_model import ContactModel, Octuple
from cellwright.kb.targets import DEVICES_FOLDER

MOST_PLACES = 5_000  # fully specified; they and their transitions are listed one by one


@dataclass(frozen=True, slots=True)
class NetRequest:
    """What is to be generated: the whole cell or only `parts` of it (objects or classes), by
    class or `full`y specified.
    """

    parts: tuple[str, ...] = ()
    full: bool = False
    forms: int = MAX_FORMS


def contact_model_of(target: str) -> tuple[ContactModel, tuple[Diagnostic, ...]]:
    """The contact model of the domain that a target names, and warnings. Raises `InvalidInput`."""
    return load_contacts(domain_of(target))


def net_space(model: ContactModel, request: NetRequest = NetRequest()) -> FormSpace:
    """The forms and steps of a cell.

    Raises `InvalidInput` for unknown parts or filters, or a start that none lets pass.
    """
    _require_known(model, request.parts)
    filters: dict[str, ContactFilter] = {
        name: contact_filter(name, model) for name in model.filters
    }
    individuals = {
        individual for cell_filter in filters.values() for individual in cell_filter.individuals()
    }
    types = token_types(model, request.parts, request.full, individuals)
    if not types:
        hint = "name objects or classes with anchor points"
        raise InvalidInput(
            [
                Diagnostic(
                    Source(model.path), "K405", "there is nothing that has anchor points", hint
                )
            ]
        )
    return generate_states(model, types, filters, request.forms)


def build_net(model: ContactModel, request: NetRequest = NetRequest()) -> ContactNet:
    """The net of a cell. Raises `InvalidInput` as `space_of` does, and if `full` there are too
    many places to list.
    """
    if request.full:
        _require_listable(model, request)
    return net_of(net_space(model, request), request.full)


def _require_listable(model: ContactModel, request: NetRequest) -> None:
    space = net_space(model, replace(request, full=False))
    count = sum(count_individuals(space, form) for form in space.forms)
    if count > MOST_PLACES or not space.complete:
        message = (
            f"{'' if space.complete else 'more than '}{count:,} fully specified places are too "
            "many to list"
        )
        hint = (
            "leave --full out: the net by contact class is small, and its states are counted "
            "all the same"
        )
        raise InvalidInput([Diagnostic(Source(model.path), "K007", message, hint)])


def contact_sequence(
    model: ContactModel, goals: Sequence[str], request: NetRequest = NetRequest()
) -> tuple[OperatorSequence, NetPlayer]:
    """The shortest sequence of operators to contact states that are written as octuples, and the
    net in play.

    Raises `InvalidInput`.
    """
    space = net_space(model, request)
    player = NetPlayer(space, net_of(space))
    return search(player, [_goal_octuple(model, goal) for goal in goals]), player


def _goal_octuple(model: ContactModel, text: str) -> Octuple:
    file = File.of("--goal", text)
    findings = LoadFindings()
    octuple = ContactTemplates(findings, model.classes, model.objects).of(
        YamlNode(text, file, 0, len(text))
    )
    require_valid(findings)
    assert octuple is not None, "what is wrong was reported"
    return octuple


def _require_known(model: ContactModel, parts: Collection[str]) -> None:
    known_names = [*model.objects, *model.classes]
    wrong = [
        unknown_name("object or class", part, known_names, Source("--reduced"))
        for part in parts
        if part not in known_names
    ]
    if wrong:
        raise InvalidInput(wrong)


def compare_net_without(model: ContactModel, whole: ContactNet, part: str) -> ObjectShare:
    """The net of a cell compared with the net without an object, or the objects of a class.

    Raises `InvalidInput`.
    """
    _require_known(model, [part])
    other_objects = tuple(
        object_name
        for object_name in model.objects
        if part not in (object_name, *model.kinds(object_name))
    )
    before = build_net(model, NetRequest(other_objects))
    known_removals = {(removal.filter, removal.reason) for removal in before.removed}
    return ObjectShare(
        part,
        len(whole.places) - len(before.places),
        len(whole.transitions) - len(before.transitions),
        whole.growth.states - before.growth.states,
        tuple(
            sorted({(removal.filter, removal.reason) for removal in whole.removed} - known_removals)
        ),
    )


def generate_domain(path: Path) -> File:
    """The planning domain that is generated from the contact model beside a domain file.

    Raises `InvalidInput`.
    """
    from cellwright.engine.pipelines.contact_states.net_domain import generated_domain_file

    model, _ = load_contacts(path)
    return generated_domain_file(model, build_net(model), load(path).domain)


def write_domain(target: str, folder: Path) -> tuple[Path, ...]:
    """Write the generated domain into a folder, with its rules, own devices and problems. Returns
    the files. Raises `InvalidInput`.

    Files that are there are not overwritten.
    """
    path = domain_of(target)
    texts = {Path(path.name): generate_domain(path).text}
    devices = (device for device in (path.parent / DEVICES_FOLDER).rglob("*") if device.is_file())
    for path_in_folder in sorted((*path.parent.glob("*.lp"), *devices, *problem_files(path))):
        texts[path_in_folder.relative_to(path.parent)] = read_file(path_in_folder).text
    existing = [folder / name for name in texts if (folder / name).exists()]
    if existing:
        message = f"{existing[0]} is there already"
        raise InvalidInput([Diagnostic(Source(str(folder)), "K403", message, "name a new folder")])
    for name, text in texts.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text, "utf-8")
    return tuple(folder / name for name in texts)
