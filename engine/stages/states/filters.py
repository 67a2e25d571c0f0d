"""Filters of contact states that come with the engine: stability, and the designer's templates."""

from collections.abc import Iterator, Sequence

from cellwright.engine.stages.states.token_types import permanent_bodies
from cellwright.kb.model.contact_model import (
    Bindings,
    ContactModel,
    Octuple,
    class_of,
    template_bindings,
)


class Stability:
    """Nothing falls: every object is held, through contacts that support, by the ground, a
    joint or a robot.
    """

    def __init__(self, model: ContactModel) -> None:
        self.model = model
        permanent = permanent_bodies(model)
        self.anchored = permanent.terminals | permanent.passive | permanent.driven
        self.clusters = [frozenset(cluster) for cluster in permanent.clusters]

    def individuals(self) -> frozenset[tuple[str, str]]:
        """No anchor point is looked at for itself."""
        return frozenset()

    def reason(
        self,
        objects: Sequence[str],
        contacts: Sequence[Octuple],
        change: Octuple | None,  # noqa: ARG002
    ) -> str:
        """Which object falls; empty if none does. In free space (`gravity: false`) none does."""
        if not self.model.gravity:
            return ""
        links = [cluster & set(objects) for cluster in self.clusters]
        links += [
            frozenset({link.first.instance, link.second.instance})
            for link in contacts
            if self._supports(link)
        ]
        supported = self.anchored & set(objects)
        while (more := supported.union(*(link for link in links if link & supported))) != supported:
            supported = more
        fallen = [self.model.objects[name] for name in objects if name not in supported]
        return f"{fallen[0]} would fall" if fallen else ""

    def _supports(self, contact: Octuple) -> bool:
        for turned in (contact, contact.turned):
            contact_class = class_of(turned, self.model.contact_classes, self.model.classes)
            if contact_class is not None:
                return contact_class.supports
        return True


class Templates:
    """What the designer excludes."""

    def __init__(self, model: ContactModel) -> None:
        self.model = model

    def individuals(self) -> frozenset[tuple[str, str]]:
        """The templates themselves say which anchor points are individuals; the token types
        know them.
        """
        return frozenset()

    def reason(
        self,
        objects: Sequence[str],  # noqa: ARG002
        contacts: Sequence[Octuple],
        change: Octuple | None,  # noqa: ARG002
    ) -> str:
        """The first template that matches; empty if none does."""
        for template in self.model.undesirable:
            if (
                next(_match_templates(self.model, template.contacts, contacts, {}), None)
                is not None
            ):
                return f"{template.name}: {template.say}" if template.say else template.name
        return ""


def _match_templates(
    model: ContactModel, templates: Sequence[Octuple], contacts: Sequence[Octuple], bound: Bindings
) -> Iterator[Bindings]:
    if not templates:
        yield bound
        return
    for contact in contacts:
        for binding in template_bindings(model, templates[0], contact, bound):
            yield from _match_templates(model, templates[1:], contacts, binding)
