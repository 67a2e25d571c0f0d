"""The `command:` of a problem file: a command in words instead of goals and a workflow."""

from cellwright.kb.diagnostics import InvalidInput, errors
from cellwright.kb.loader.reader import Reader
from cellwright.kb.model.problem import Problem


def commanded(problem: Problem, reader: Reader) -> Problem:
    """The problem with the goal and chains of its `command:`, if it has one. Errors are added to the findings."""
    node = reader.root.value.get("command", (None, None))[1]
    if node is None or not isinstance(node.value, str) or not node.value:
        return problem
    if reader.items("goals") or reader.items("workflow"):
        hint = "write either a command, or goals and a workflow"
        reader.findings.add(
            node.where, "K005", "a problem cannot have both a command and goals or a workflow", hint
        )
    if errors(reader.findings.diagnostics):
        return problem  # while the domain or the objects have errors, the words cannot be understood
    from cellwright.kb.commands import understand  # slow to import, and few problems have a command

    try:
        return understand(problem, node.value, node.place)
    except InvalidInput as error:
        for found in error.diagnostics:
            reader.findings.note(found)
        return problem
