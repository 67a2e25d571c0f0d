"""The phrases of a domain as one tree of words and slots, in every order in which their parts can be said."""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from cellwright.kb.commands.patterns import Pattern, Slot, Variant, Word, expansions, variants
from cellwright.kb.commands.spelling import parts


@dataclass(frozen=True, slots=True)
class Form:
    """One way of saying a phrase: its number, its parts, and whether they are in another order than the written one."""

    phrase: int
    parts: Variant
    moved: bool

    @property
    def verb(self) -> tuple[str, ...]:
        """The words before the first slot; for a phrase without slots, the first word and a particle after it."""
        words = tuple(part.text if isinstance(part, Word) else "" for part in self.parts)
        if "" in words:
            return words[: words.index("")]
        return words[: 2 if words[1:2] and words[1] in PARTICLES else 1]


PARTICLES = frozenset({"up", "down", "on", "off", "out", "back", "away"})


@dataclass(slots=True)
class Node:
    """A place in the tree: where each word and each type of slot leads, and the forms that end here."""

    words: dict[str, "Node"] = field(default_factory=dict)
    slots: dict[str, "Node"] = field(default_factory=dict)
    ends: list[Form] = field(default_factory=list)

    def after(self, part: Word | Slot) -> "Node":
        """The node behind a part, which is made if there is none."""
        if isinstance(part, Word):
            return self.words.setdefault(part.text, Node())
        return self.slots.setdefault(part.type, Node())


@functools.lru_cache(16)
def tree(patterns: tuple[Pattern, ...], moved: bool) -> Node:
    """The root of the tree of all forms of the patterns: those as written, or those in another order."""
    root = Node()
    for form in forms(patterns):
        if form.moved != moved:
            continue
        node = root
        for each in form.parts:
            node = node.after(each)
        if not any(end.phrase == form.phrase and end.parts == form.parts for end in node.ends):
            node.ends.append(form)
    return root


def forms(patterns: Sequence[Pattern]) -> Iterator[Form]:
    """Every way of saying every pattern, in the order of the patterns."""
    for number, pattern in enumerate(patterns):
        for expansion in expansions(pattern):
            for variant, moved in variants(expansion):
                yield Form(number, variant, moved)


def gerunds(verb: str) -> tuple[str, ...]:
    """What a verb may look like after "after" and "before": heating, storing, putting."""
    if verb.endswith("ie"):
        return (f"{verb[:-2]}ying",)
    short = (f"{verb[:-1]}ing",) if verb.endswith("e") else ()
    return (*short, f"{verb}ing", f"{verb}{verb[-1]}ing")


_IRREGULAR = (
    "put put,take taken,bring brought,hold held,give given,cut cut,spin spun,shut shut,set set,send sent,read read,get got,"
    "make made,lay laid,find found,feed fed,wind wound,draw drawn,drive driven,write written,shake shaken,freeze frozen,"
    "grind ground,bend bent,hang hung,leave left,open opened open,sweep swept,stick stuck,burn burnt burned,go gone,do done"
)
IRREGULAR = {words.split()[0]: tuple(words.split()[1:]) for words in _IRREGULAR.split(",")}


def participles(verb: str) -> tuple[str, ...]:
    """What a verb may look like after "is" and "have": heated, stored, put."""
    if verb in IRREGULAR:
        return IRREGULAR[verb]
    if verb.endswith("e"):
        return (f"{verb}d",)
    return f"{verb}ed", f"{verb}{verb[-1]}ed", *((f"{verb[:-1]}ied",) if verb.endswith("y") else ())


def spoken(say: str) -> tuple[str, ...]:
    """The words of a noun, in small letters, joined ones taken apart."""
    words = say.lower().replace("’", "'").split()
    return tuple(part for word in words for part in parts(word))


def plurals(noun: str) -> tuple[str, ...]:
    """A noun and its plurals, as people may spell them."""
    if noun.endswith("y") and noun[-2:-1] not in tuple("aeiou"):
        return noun, f"{noun[:-1]}ies", f"{noun}s"
    return (
        (noun, f"{noun}es", f"{noun}s") if noun.endswith(("s", "x", "z", "ch", "sh")) else (noun, f"{noun}s")
    )
