"""The keywords of PDDL files.

A misspelt one is an error, so that nothing is passed over without a word.
"""

from collections.abc import Sequence

from cellwright.engine.formats.interop.pddl.expressions import Document, Expression, Group, PddlWord
from cellwright.kb.diagnostics import nearest_hint

TIMED_DOMAIN = "domain with times"
SECTIONS = {
    "domain": (
        "domain",
        ":requirements",
        ":types",
        ":constants",
        ":predicates",
        ":functions",
        ":action",
        ":derived",
    ),
    TIMED_DOMAIN: (
        "domain",
        ":requirements",
        ":types",
        ":constants",
        ":predicates",
        ":functions",
        ":action",
        ":durative-action",
        ":derived",
    ),
    "problem": ("problem", ":domain", ":requirements", ":objects", ":init", ":goal", ":metric"),
}
REPEATED = (
    ":action",
    ":durative-action",
    ":derived",
    ":types",
    ":constants",
    ":predicates",
    ":functions",
    ":requirements",
)
UNREAD = (
    ":durative-action",
    ":constraints",
    ":process",
    ":event",
    ":method",
    ":task",
    ":tasks",
    ":htn",
    ":axiom",
    ":timeless",
    ":length",
    ":situation",
    ":bounds",
    ":observe",
    ":agent",
    ":private",
    ":safety",
    ":extends",
)
UNREAD_FIELDS = (
    ":vars",
    ":duration",
    ":condition",
    ":observe",
    ":expansion",
    ":only-in-expansions",
    ":cost",
)
# of an action, by the section that it is
ACTION_FIELDS = {
    ":action": (":parameters", ":precondition", ":effect"),
    ":durative-action": (":parameters", ":duration", ":condition", ":effect"),
}
REQUIREMENTS = (
    ":strips",
    ":typing",
    ":negative-preconditions",
    ":disjunctive-preconditions",
    ":equality",
    ":existential-preconditions",
    ":universal-preconditions",
    ":quantified-preconditions",
    ":conditional-effects",
    ":fluents",
    ":numeric-fluents",
    ":object-fluents",
    ":adl",
    ":ucpop",
    ":durative-actions",
    ":duration-inequalities",
    ":continuous-effects",
    ":derived-predicates",
    ":timed-initial-literals",
    ":timed-initial-fluents",
    ":preferences",
    ":constraints",
    ":action-costs",
    ":goal-utilities",
    ":time",
    ":timed-effects",
    ":timed-initial-effects",
    ":domain-axioms",
    ":subgoal-through-axioms",
    ":safety-constraints",
    ":expression-evaluation",
    ":open-world",
    ":true-negation",
    ":action-expansions",
    ":foreach-expansions",
    ":dag-expansions",
    ":multi-agent",
    ":factored-privacy",
    ":unfactored-privacy",
    ":hierarchy",
    ":method-preconditions",
    ":htn",
    ":htn-method-prec",
    ":non-deterministic",
    ":probabilistic-effects",
    ":rewards",
    ":mdp",
    ":contingent",
    ":partial-observability",
    ":no-duplicates",
    ":supply-demand",
    ":negative-effects",
    ":processes",
    ":events",
    ":timed-literals",
)


def check_sections(document: Document, kind: str) -> None:
    """Note what a file of a kind of `SECTIONS` has that is no section, is not read, or stands
    there twice.
    """
    root = document.root
    if root.head != "define":
        said = (
            f"'{root.head}' begins no PDDL file" if root.head else "a PDDL file is one (define ...)"
        )
        document.add(root, "K801", said, "write (define ...)")
        return
    seen: set[str] = set()
    for part in root.rest:
        if not isinstance(part, Group) or not part.head:
            document.add(part, "K801", "a section is a keyword with what it says, in parentheses")
            continue
        if part.head in seen and part.head in SECTIONS[kind] and part.head not in REPEATED:
            document.add(part, "K104", f"{part.head} stands here twice", "put both together")
        seen.add(part.head)
        _check_section(document, part, kind)
    named = SECTIONS[kind][0]
    if named not in seen:
        document.add(
            root, "K801", f"the {named} has no name", f"begin with (define ({named} name) ...)"
        )


def _check_section(document: Document, part: Group, kind: str) -> None:
    known = SECTIONS[kind]
    if part.head == ":requirements":
        _check_requirements(document, part)
    elif part.head not in known:
        near = "" if part.head in UNREAD else nearest_hint(part.head, [*known, *UNREAD])
        hint = near or "what is read stands in docs/pddl.md"
        document.add(part, "K802", f"{part.head} is not supported", hint)


def _check_requirements(document: Document, part: Group) -> None:
    for each in part.rest:
        text = each.text if isinstance(each, PddlWord) else ""
        if text not in REQUIREMENTS:
            near = nearest_hint(text, list(REQUIREMENTS))
            document.add(each, "K801", f"'{text or '('}' is no requirement of PDDL", near)


def check_actions(document: Document, actions: Sequence[Group]) -> None:
    """Note two actions of one name, and what an action has that is no field, is not read, or
    stands there twice.
    """
    names: set[str] = set()
    for action in actions:
        name = action.rest[0] if action.rest else None
        if isinstance(name, PddlWord) and name.text in names:
            document.add(name, "K104", f"action '{name.text}' is declared twice")
        names |= {name.text} if isinstance(name, PddlWord) else set()
        _check_action(document, action)


def _check_action(document: Document, action: Group) -> None:
    parts = list(action.rest[1:])
    fields = ACTION_FIELDS.get(action.head, ACTION_FIELDS[":action"])
    seen: set[str] = set()
    while parts:
        key = parts.pop(0)
        _check_field(document, key, fields, seen)
        following = parts[0] if parts else None
        if following is None or (
            isinstance(following, PddlWord) and following.text.startswith(":")
        ):
            if isinstance(key, PddlWord):
                document.add(
                    key,
                    "K801",
                    f"nothing is said after {key.text}",
                    "write it in parentheses, or leave it out",
                )
        else:
            parts.pop(0)


def _check_field(
    document: Document, key: Expression, fields: Sequence[str], seen: set[str]
) -> None:
    text = key.text if isinstance(key, PddlWord) else ""
    if text in UNREAD_FIELDS and text not in fields:
        hint = "a :durative-action has times" if text in ACTION_FIELDS[":durative-action"] else ""
        hint = hint or "what is read stands in docs/pddl.md"
        document.add(key, "K802", f"{text} is not supported", hint)
    elif text not in fields:
        document.add(
            key,
            "K801",
            f"'{text or '('}' is no field of an action",
            nearest_hint(text, list(fields)),
        )
    elif text in seen:
        document.add(key, "K104", f"{text} stands here twice", "put both together with (and ...)")
    seen.add(text)
