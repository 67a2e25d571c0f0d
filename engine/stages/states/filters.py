"""The filters that come with the engine: stability and the designer's templates. Others are plug-ins."""

from collections.abc import Iterator, Sequence

from cellwright.engine.stages.states.tokens import bodies
from cellwright.kb.model.contacts import ContactModel, class_of, describes
from cellwright.kb.model.octuples import Bindings, Octuple


class Stability:
    """Nothing falls: every object is held, through contacts that support, by the ground, a joint or a robot."""

    def __init__(self, model: ContactModel) -> None:
        self.model = model
        found = bodies(model)
        self.anchored = found.terminals | found.passive | found.driven
        self.clusters = [frozenset(each) for each in found.clusters]

    def individuals(self) -> frozenset[tuple[str, str]]:
        """No anchor point is looked at for itself."""
        return frozenset()

    def reason(self, objects: Sequence[str], contacts: Sequence[Octuple], change: Octuple | None) -> str:  # noqa: ARG002 - the port has it
        """Which object falls; empty if none does. In free space (`gravity: false`) none does."""
        if not self.model.gravity:
            return ""
        links = [each & set(objects) for each in self.clusters]
        links += [
            frozenset({each.first.instance, each.second.instance})
            for each in contacts
            if self._supports(each)
        ]
        held = self.anchored & set(objects)
        while (more := held.union(*(link for link in links if link & held))) != held:
            held = more
        fallen = [self.model.objects[each] for each in objects if each not in held]
        return f"{fallen[0]} would fall" if fallen else ""

    def _supports(self, contact: Octuple) -> bool:
        for turned in (contact, contact.turned):
            found = class_of(turned, self.model.contact_classes, self.model.classes)
            if found is not None:
                return found.supports
        return True


class Templates:
    """What the designer excludes."""

    def __init__(self, model: ContactModel) -> None:
        self.model = model

    def individuals(self) -> frozenset[tuple[str, str]]:
        """The templates themselves say which anchor points are individuals; the token types know them."""
        return frozenset()

    def reason(self, objects: Sequence[str], contacts: Sequence[Octuple], change: Octuple | None) -> str:  # noqa: ARG002 - the port has it
        """The first template that matches; empty if none does."""
        for each in self.model.undesirable:
            if next(_matched(self.model, each.contacts, contacts, {}), None) is not None:
                return f"{each.name}: {each.say}" if each.say else each.name
        return ""


def _matched(
    model: ContactModel, templates: Sequence[Octuple], contacts: Sequence[Octuple], bound: Bindings
) -> Iterator[Bindings]:
    if not templates:
        yield bound
        return
    for contact in contacts:
        for found in describes(model, templates[0], contact, bound):
            yield from _matched(model, templates[1:], contacts, found)
