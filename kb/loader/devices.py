"""What an operator has to do with devices: the command that one is sent, and what is looked at in the cell (`online`)."""

from collections.abc import Iterator
from dataclasses import dataclass

from cellwright.kb.diagnostics import nearest
from cellwright.kb.loader.inference import Typing
from cellwright.kb.loader.measures import MeasureReader
from cellwright.kb.loader.names import READABLE, Names
from cellwright.kb.loader.quantities import child
from cellwright.kb.loader.reader import Expression, Reader
from cellwright.kb.model.domain import Command, Look
from cellwright.kb.terms import Function, variables


@dataclass(frozen=True)
class DeviceReader:
    """Reads what the operator at `path` with this header tells devices and asks of them."""

    reader: Reader
    names: Names
    path: tuple[str, ...]
    header: Expression

    def command(self, measures: MeasureReader) -> Command | None:
        """The command with what it measures; None if there is none. What is wrong with it goes to the findings."""
        stream, reply, result = (self._term(name) for name in ("stream", "reply", "result"))
        if stream is None:
            return None
        for expression in filter(None, (stream, result)):
            self._refuse_strangers(expression, reply)
        header = self.header.value
        return Command(
            stream.value,
            reply.value if reply else Function("done"),
            result.value if result else None,
            measures.read(header.name, header.arguments, reply.value if reply else None),
        )

    def _term(self, name: str) -> Expression | None:
        return self.reader.expression("term", *self.path, "command", name)

    def _refuse_strangers(self, expression: Expression, reply: Expression | None) -> None:
        """Report variables that neither the header nor the reply has."""
        known = {*self.header.value.arguments, *(variables(reply.value) if reply else ())}
        for variable in variables(expression.value):
            if variable not in known:
                message = f"the variable {variable} is neither in the header nor in the reply"
                hint = nearest(str(variable), [str(each) for each in known])
                hint = hint or "let the reply bind it: `reply: value(Val)`"
                self.names.findings.add(expression.place(variable), "K105", message, hint)

    def looks(self, typing: Typing) -> Iterator[Look]:
        """What is looked at when a step is carried out: each entry is one fact that its arguments determine."""
        for index, node in enumerate(self.reader.items(*self.path, "online")):
            said = self.reader.expression("atoms", *self.path, "online", index, "fact")
            if said is None:
                continue
            strangers = [v for v in variables(said.value[0]) if v not in self.header.value.arguments]
            if strangers or len(said.value) > 1:
                message = f"`online` looks at one fact about the variables of {self.header.value}"
                hint = "write an entry for each fact"
                self.names.findings.add(said.node.where, "K105", message, hint)
                continue
            typing.nested().atom(said.value[0], said, READABLE)
            during = child(node, "during")
            yield Look(said.value[0], during is not None and during.value == "true")
