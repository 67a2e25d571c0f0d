"""The workflow in flat terms: a counter for each chain, and the events that advance it."""

from collections.abc import Iterator

from cellwright.engine.formats.interop.pddl.export.export_statics import (
    CHAIN,
    NUMERAL,
    Background,
    FreshVariables,
    NotLiftable,
)
from cellwright.kb.model.conditions import And, Condition, Literal, Parameter
from cellwright.kb.model.domain_model import Effect, Kind, Operator
from cellwright.kb.model.planning_problem import (
    Chain,
    Listed,
    final_stages,
    initial_progress,
    late_stages,
    reaches_stage,
    stage_holds,
)
from cellwright.kb.terms import TOGETHER_SIGN, Atom, Function, Number, Text, is_ground

REACHED, BEGIN, REACH = "_reached", "_begin", "_reach"
Happening = tuple[Condition, tuple[Parameter, ...], tuple[Effect, ...]]


def chain_object(chain: Chain) -> Function:
    """The object that stands for a chain."""
    return Function(CHAIN, (Text(chain.name),))


def stage_reached(chain: Chain, count: int) -> Atom:
    """The fluent that says how many stages of a chain are reached."""
    return Function(REACHED, (chain_object(chain), Number(count)))


class ChainCounters:
    """The chains of a problem as fluents, static facts and effects."""

    def __init__(self, background: Background, fresh: FreshVariables) -> None:
        self.background, self.fresh = background, fresh
        self.chains = background.problem.chains
        if any(stage.name == TOGETHER_SIGN for chain in self.chains for stage in chain.stages):
            raise NotLiftable("a stage of several conditions")
        if late := late_stages(self.chains, background.domain):
            raise NotLiftable(f"{late[0]}, a stage that stays and has to wait for its turn")
        stages = dict.fromkeys(stage.name for chain in self.chains for stage in chain.stages)
        self.fluents = [name for name in stages if background.kinds.get(name) is not Kind.EVENT]
        self.begun = initial_progress(
            self.chains, stage_holds(Listed(background.task.names(background.task.initial)))
        )

    def facts(self) -> Iterator[Atom]:
        """A fact for each stage: the atom that moves a chain from one count to the next."""
        for chain in self.chains:
            for count, stage in enumerate(chain.stages):
                for atom in self._matching(stage):
                    place = (chain_object(chain), Number(count), Number(count + 1))
                    yield Function(f"_stage_{stage.name}", (*atom.arguments, *place))

    def _matching(self, stage: Atom) -> list[Atom]:
        if is_ground(stage):
            return [stage]
        return [atom for atom in self.background.task.atoms if reaches_stage(atom, stage)]

    def initial(self) -> Iterator[Atom]:
        """The counters at the start: chains that wait for no other chain are at their
        beginning, or at what holds already.
        """
        return (
            stage_reached(chain, self.begun[chain.name])
            for chain in self.chains
            if not self._waits(chain)
        )

    def _waits(self, chain: Chain) -> bool:
        return bool(chain.after) and not self.begun[chain.name]

    def beginnings(self) -> Iterator[Operator]:
        """A step for each chain that waits for other chains: it begins the chain when they are
        finished.
        """
        length = {chain.name: (chain, len(chain.stages)) for chain in self.chains}
        for number, chain in enumerate(self.chains):
            if self._waits(chain):
                finished = [Literal(stage_reached(*length[name])) for name in chain.after]
                yet = Function(f"{BEGIN}_{number}_yet")
                effects = (Effect(stage_reached(chain, 0)), Effect(yet, False))
                condition = And((*finished, Literal(yet)))
                yield Operator(f"{BEGIN}_{number}", (), condition, effects, cost=Number(0))

    def waiting(self) -> Iterator[Atom]:
        """The atoms that the beginning steps consume, so that each happens only once."""
        return (
            Function(f"{BEGIN}_{n}_yet")
            for n, chain in enumerate(self.chains)
            if self._waits(chain)
        )

    def goals(self) -> Iterator[Condition]:
        """Every chain is finished.

        A fluent that ends a chain still holds, unless a later chain of the same subject follows.
        """
        lasts = final_stages(self.chains, self.background.domain)
        for chain in self.chains:
            yield Literal(stage_reached(chain, len(chain.stages)))
            if chain.name in lasts:
                yield from map(Literal, lasts[chain.name])

    def happening(self, number: int, event: Atom) -> Happening:
        """The condition that an event is the next stage of some chain, with its parameters and
        the effects on the chain.
        """
        if number:
            raise NotLiftable("several events in one operator")
        parameters = self._parameters()
        static = Literal(
            Function(f"_stage_{event.name}", (*event.arguments, *(p.variable for p in parameters)))
        )
        held, *effects = self._moves(parameters)
        return And((static, Literal(held.atom))), parameters, (held, *effects)

    def reachings(self) -> Iterator[Operator]:
        """A step for each fluent that is a stage: it advances a chain whose next stage the
        fluent is, and holds.
        """
        for name in self.fluents:
            own = tuple(
                Parameter(self.fresh.variable("of"), type_)
                for type_ in self.background.signature(name)
            )
            parameters = self._parameters()
            fluent = Function(name, tuple(parameter.variable for parameter in own))
            arguments = (*fluent.arguments, *(parameter.variable for parameter in parameters))
            moves = self._moves(parameters)
            held = (
                Literal(Function(f"_stage_{name}", arguments)),
                Literal(fluent),
                Literal(moves[0].atom),
            )
            yield Operator(f"{REACH}_{name}", (*own, *parameters), And(held), moves, cost=Number(0))

    def _parameters(self) -> tuple[Parameter, ...]:
        names = (("chain", CHAIN), ("stage", NUMERAL), ("next", NUMERAL))
        return tuple(Parameter(self.fresh.variable(name), type_) for name, type_ in names)

    def _moves(self, parameters: tuple[Parameter, ...]) -> tuple[Effect, Effect]:
        chain, before, after = (parameter.variable for parameter in parameters)
        return Effect(Function(REACHED, (chain, before)), False), Effect(
            Function(REACHED, (chain, after))
        )
