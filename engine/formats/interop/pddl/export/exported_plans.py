"""Plans between an export and its problem: operator instances as PDDL actions, and back."""

from collections.abc import Iterable, Iterator, Mapping, Set
from dataclasses import dataclass

from cellwright.engine.formats.interop.pddl.export.chain_counters import BEGIN, REACH, chain_object
from cellwright.engine.formats.interop.pddl.export.flat_operators import FlatOperator
from cellwright.engine.formats.interop.pddl.export.flat_problem import FlatProblem
from cellwright.engine.formats.interop.pddl.export.pddl_names import PddlNames
from cellwright.engine.formats.interop.pddl.expressions import plan_actions
from cellwright.engine.model.ground_task import GroundOperator, GroundTask
from cellwright.engine.model.workflow_replay import (
    STAGE_OPERATOR,
    operators_by_instance,
    replay_instances,
    stage_atom,
)
from cellwright.kb.diagnostics import Diagnostic, InvalidInput, Source, nearest_hint
from cellwright.kb.files import File
from cellwright.kb.model.plan_model import Plan, Step, StepId
from cellwright.kb.model.planning_problem import Problem, reaches_stage
from cellwright.kb.terms import Atom, Function, Number, Term, Text, Variable, substitute_term


def _plan_of_instances(instances: list[Function], task: GroundTask) -> Plan:
    known = {operator.instance: operator for operator in reversed(task.operators)}
    steps = []
    for number, instance in enumerate(instances, 1):
        operator = known.get(instance)
        after = (StepId(number - 1),) if number > 1 else ()
        held, duration, cost = (
            (operator.resources, operator.duration, operator.cost) if operator else ((), 0, 1)
        )
        steps.append(Step(StepId(number), instance, after, held, duration, cost))
    return Plan(tuple(steps))


class LiftedPlans:
    """Plans for a lifted export."""

    def __init__(
        self, flat: FlatProblem, names: PddlNames, problem: Problem, task: GroundTask
    ) -> None:
        self.names, self.problem, self.task = names, problem, task
        self.operators = {
            names.of("action", origin.operator.name): origin for origin in flat.origins
        }
        self.others = {
            names.of("action", flat_operator.name)
            for flat_operator in flat.operators
            if flat_operator.name.startswith((BEGIN, REACH))
        }
        self.terms = {names.term(term): term for term in flat.objects}

    def read(self, text: str, name: str) -> Plan:
        """The plan in `text`, without the steps that only move chains: they are no operators of
        the problem.
        """
        file, diagnostics, instances = File.of(name, text), list[Diagnostic](), list[Function]()
        for words, offset in plan_actions(text):
            if words[0] not in self.others:
                read = self._instance(words, file.at(offset))
                if isinstance(read, Function):
                    instances.append(read)
                else:
                    diagnostics.append(read)
        if diagnostics:
            raise InvalidInput(diagnostics)
        return _plan_of_instances(instances, self.task)

    def _instance(self, words: list[str], where: Source) -> Function | Diagnostic:
        """The operator instance that an action stands for, or the error in its line."""
        operator = self.operators.get(words[0])
        if operator is None:
            hint = nearest_hint(words[0], list(self.operators))
            return Diagnostic(where, "K101", f"unknown action '{words[0]}'", hint)
        count = sum(
            parameter.type != "int" for parameter in operator.operator.parameters
        )  # a cost is not an argument
        if len(words) != count + 1:
            return Diagnostic(
                where, "K102", f"{words[0]} takes {count} arguments, not {len(words) - 1}"
            )
        if unknown := [word for word in words[1:] if word not in self.terms]:
            hint = nearest_hint(unknown[0], list(self.terms))
            return Diagnostic(where, "K101", f"unknown object '{unknown[0]}'", hint)
        terms = (self.terms[word] for word in words[1 : operator.header + 1])
        return Function(operator.operator.name, tuple(terms))

    def written(self, plan: Plan) -> str:
        """The steps of the plan in order, each with all arguments of its action, and behind it
        what moves chains then.
        """
        by_name = {
            flat_operator.operator.name: flat_operator for flat_operator in self.operators.values()
        }
        steps = iter(plan.steps)
        lines: list[str] = []
        for operator in _ground_operators(plan, self.task):
            if operator.instance.name == STAGE_OPERATOR:
                lines += [*self._beginnings(operator), self._reaching(operator)]
                continue
            step = next(steps)
            lines += self._beginnings(operator)
            words = self._arguments(
                by_name[step.operator.name], step, set(self.task.names(operator.adds))
            )
            lines.append(self._line(step.operator.name, words))
        return "".join(f"({line})\n" for line in lines)

    def _line(self, action: str, words: Iterable[Term]) -> str:
        return " ".join([self.names.of("action", action), *map(self.names.term, words)])

    def _beginnings(self, operator: GroundOperator) -> Iterator[str]:
        """The steps that begin the chains whose first stage an operator reaches."""
        reached = self.task.names(operator.adds)
        for number, chain in enumerate(self.problem.chains):
            if chain.after and stage_atom(chain, 1) in reached:
                yield self.names.of("action", f"{BEGIN}_{number}")

    def _reaching(self, operator: GroundOperator) -> str:
        """The step that moves a chain where a fluent holds."""
        name, count = operator.instance.arguments
        assert isinstance(count, Number)
        chain = next(
            named_chain for named_chain in self.problem.chains if Text(named_chain.name) == name
        )
        stage = chain.stages[count.value - 1]
        fluent = next(a for a in self.task.names(operator.preconditions) if reaches_stage(a, stage))
        place = (chain_object(chain), Number(count.value - 1), count)
        return self._line(f"{REACH}_{stage.name}", (*fluent.arguments, *place))

    def _arguments(self, operator: FlatOperator, step: Step, reached: Set[Atom]) -> Iterator[Term]:
        """The arguments of an action; `reached` are the atoms that the step makes true, stages
        of chains among them.
        """
        yield from step.operator.arguments
        variables = operator.operator.variables
        bindings: dict[Variable, Term] = dict(zip(variables, step.operator.arguments, strict=False))
        yield from (substitute_term(term, bindings) for term in operator.terms)
        for event in operator.events:
            atom = substitute_term(event, bindings)
            for chain in self.problem.chains:
                for count, stage in enumerate(chain.stages):
                    if stage == atom and stage_atom(chain, count + 1) in reached:
                        yield from (chain_object(chain), Number(count), Number(count + 1))


def _ground_operators(plan: Plan, task: GroundTask) -> list[GroundOperator]:
    """The ground operators of a plan's steps, with the internal ones that move chains.

    Raises `ValueError`.
    """
    replayed_operators = replay_instances(
        task, operators_by_instance(task), task.initial, [step.operator for step in plan.steps]
    )
    if replayed_operators is None:
        raise ValueError("a step cannot be done there")
    return replayed_operators


@dataclass(frozen=True, slots=True)
class GroundPlans:
    """Plans for a ground export."""

    actions: Mapping[str, GroundOperator]
    task: GroundTask

    def read(self, text: str, name: str) -> Plan:
        """The plan in `text`, without the steps that only the compiled goal needs: they are no
        operators of the problem.
        """
        file, diagnostics, instances = File.of(name, text), list[Diagnostic](), list[Function]()
        for words, offset in plan_actions(text):
            operator = self.actions.get(" ".join(words))
            if operator is None:
                hint = nearest_hint(words[0], list(self.actions))
                diagnostics.append(
                    Diagnostic(file.at(offset), "K101", f"unknown action '{words[0]}'", hint)
                )
            elif not operator.instance.name.startswith("_"):
                instances.append(operator.instance)
        if diagnostics:
            raise InvalidInput(diagnostics)
        return _plan_of_instances(instances, self.task)

    def written(self, plan: Plan) -> str:
        """The steps of the plan in order.

        Of several operators for one instance, it takes an applicable one that gets furthest.
        """
        names = {operator: name for name, operator in self.actions.items()}
        operators = _ground_operators(plan, self.task)
        state = self.task.initial
        for operator in operators:
            state = self.task.after(state, operator)
        # those that close the plan and note which goals are met
        for operator in self.task.operators:
            if (
                operator.instance.name in ("_ends", "_meets")
                and not operator.preconditions & ~state
            ):
                operators.append(operator)
                state = self.task.after(state, operator)
        return "".join(f"({names[operator]})\n" for operator in operators)
