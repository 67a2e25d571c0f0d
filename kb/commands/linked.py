"""How a sentence says an act that another one comes after or before: "heating probe 1", "probe 1 is heated", "you have heated it"."""

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace

from cellwright.kb.commands.matching import LEFT_OUT, Match, Matcher
from cellwright.kb.commands.patterns import PREPOSITIONS, Slot
from cellwright.kb.commands.phrasebook import PARTICLES, Form, Node, gerunds, participles
from cellwright.kb.commands.reading import Said
from cellwright.kb.commands.words import Words

SUBJECTS = ("you", "we", "i", "they", "robot", "cell")
HAVE = ("have", "has", "had")
BE = tuple(
    tuple(each.split())
    for each in ["is", "are", "was", "were", "has been", "have been", "had been", "gets", "get"]
)
_SHOULD = (
    "should be,must be,shall be,is to be,are to be,has to be,have to be,ought to be,needs to be,need to be,will be"
    ",should get,must get"
)
SHOULD = tuple(tuple(each.split()) for each in _SHOULD.split(","))

Named = tuple[int, tuple[Words, ...]]
"""The place after an act that was said before, and what fills its slots now."""


def linked(matcher: Matcher, begin: int) -> Iterator[Match]:
    """The acts that are said whole behind "after", "once" or "before"."""
    for root in (matcher.book.natural, matcher.book.moved):
        for verb, node in root.words.items():
            for end in _verbs(matcher.said, begin, verb):
                yield from matcher.walk(node, end, ())
    for words, node in _verb_nodes(matcher):
        yield from _passive(matcher, words, node, begin, BE)
        yield from _participles_alone(matcher, words, node, begin)


def wished(matcher: Matcher, begin: int, goes_on: bool) -> Iterator[Match]:
    """The acts that are said as what should be done: "probe 1 must be heated for 5 min", and behind such: "and then cooled"."""
    if not goes_on and not _says_should(matcher.said):
        return
    for verb, node in _verb_nodes(matcher):
        found = _passive(matcher, verb, node, begin, SHOULD)
        yield from (replace(each, passive=True) for each in found)
        if goes_on:
            yield from (
                replace(each, passive=True) for each in _participles_alone(matcher, verb, node, begin)
            )


def _says_should(said: Said) -> bool:
    words = [piece.lower for piece in said.pieces]
    return any(tuple(words[n : n + len(each)]) == each for n in range(len(words)) for each in SHOULD)


def _verb_nodes(matcher: Matcher) -> Iterator[tuple[tuple[str, ...], Node]]:
    """The verbs of the phrases with the nodes behind them."""
    for verb, node in matcher.book.natural.words.items():
        yield from (((verb, *particles), start) for particles, start in _particles(node))


def _passive(
    matcher: Matcher, verb: tuple[str, ...], node: Node, begin: int, be: Iterable[tuple[str, ...]]
) -> Iterator[Match]:
    """Acts in the passive. `node` is behind the words of the verb."""
    for place, values, following in _objects(matcher, node, begin):
        for end in _passives(matcher.said, place, verb, be):
            yield from matcher.walk(following, end, values)


def _participles_alone(matcher: Matcher, verb: tuple[str, ...], node: Node, begin: int) -> Iterator[Match]:
    """Acts of which only the participle is said, for objects that were named before: "... and cooled for 3 min"."""
    for words, following in _left_out(matcher, node, begin):
        for end in _participle(matcher.said, begin, verb):
            yield from matcher.walk(following, end, (words,))


def again(matcher: Matcher, begin: int, earlier: Iterable[tuple[Form, tuple[Words, ...]]]) -> Iterator[Match]:
    """The acts of earlier clauses that are said again in short: "once heated", "after heating it", "once probe 1 is heated"."""
    for form, values in earlier:
        for end, now in (*_repeated(matcher, begin, form, values), *_done(matcher, begin, form, values)):
            yield Match(end, form, now, LEFT_OUT, again=True)


def _repeated(matcher: Matcher, begin: int, form: Form, values: tuple[Words, ...]) -> Iterator[Named]:
    """Active: the verb, with or without its first object."""
    verb, *rest = form.verb
    for place in _verbs(matcher.said, begin, verb):
        end = _heard_all(matcher.said, place, rest)
        if end is not None:
            yield end, values
            yield from ((after, (words, *values[1:])) for after, words in _first(matcher, end, form))


def _done(matcher: Matcher, begin: int, form: Form, values: tuple[Words, ...]) -> Iterator[Named]:
    """Passive: the participle, with or without the first object."""
    verb = tuple(word for word in form.verb if word not in PREPOSITIONS)
    for end in _participle(matcher.said, begin, verb):
        yield end, values
    for place, words in _first(matcher, begin, form):
        yield from ((end, (words, *values[1:])) for end in _passives(matcher.said, place, verb))


def _first(matcher: Matcher, place: int, form: Form) -> Iterator[tuple[int, Words]]:
    """What can fill the first slot of a form from a place on."""
    slot = next((part for part in form.parts if isinstance(part, Slot)), None)
    if slot is not None:
        for end, words in matcher.slot(slot.type, place):
            if words.how == "bare" and not words.but:
                yield end, replace(words, how="pronoun")  # "once all are heated": all that were said
            elif words.how != "omitted":
                yield end, words


def _verbs(said: Said, begin: int, verb: str) -> Iterator[int]:
    """The places after a verb: heating, having heated, you heat, you have heated."""
    yield from _heard(said, begin, gerunds(verb))
    for having in _heard(said, begin, ("having",)):
        yield from _heard(said, having, participles(verb))
    for subject in _heard(said, begin, SUBJECTS):
        yield from _heard(said, subject, (verb, f"{verb}s"))
        for have in _heard(said, subject, HAVE):
            yield from _heard(said, have, participles(verb))


def _passives(
    said: Said, place: int, verb: tuple[str, ...], be: Iterable[tuple[str, ...]] = BE
) -> Iterator[int]:
    """The places after "is heated", "has been picked up"; or, with other words of `be`, after "must be heated"."""
    for words in be:
        if (end := _heard_all(said, place, words)) is not None:
            yield from _participle(said, end, verb)


def _participle(said: Said, place: int, verb: tuple[str, ...]) -> Iterator[int]:
    for end in _heard(said, place, participles(verb[0])):
        if (last := _heard_all(said, end, verb[1:])) is not None:
            yield last


def _particles(node: Node) -> Iterator[tuple[tuple[str, ...], Node]]:
    """The node behind a verb, and those behind one word such as "up" more."""
    yield (), node
    yield from (((word,), following) for word, following in node.words.items() if word in PARTICLES)


def _objects(matcher: Matcher, node: Node, place: int) -> Iterator[tuple[int, tuple[Words, ...], Node]]:
    """What a phrase names first, a slot or words, from a place on: the place after it, what fills the slot, the node behind it."""
    for type_, following in node.slots.items():
        for end, words in matcher.slot(type_, place):
            if words.how != "omitted":
                yield end, (words,), following
    for word, following in node.words.items():
        if word not in PREPOSITIONS | PARTICLES:
            for end in _heard(matcher.said, place, (word,)):
                yield end, (), following
                yield from ((e, v, n) for e, v, n in _objects(matcher, following, end) if not v)


def _left_out(matcher: Matcher, node: Node, place: int) -> Iterator[tuple[Words, Node]]:
    """The slots behind a node that may be left out here, with what is in them then: "... and cooled for 3 min"."""
    for type_, following in node.slots.items():
        yield from ((words, following) for _, words in matcher.slot(type_, place) if words.how == "omitted")


def _heard(said: Said, place: int, words: Collection[str]) -> Iterator[int]:
    """The place after one of some words, which are not noted as what would be understood here."""
    piece = said.at(place)
    if piece is not None and piece.lower in words:
        yield said.start(place) + 1


def _heard_all(said: Said, place: int, words: Iterable[str]) -> int | None:
    end: int | None = place
    for word in words:
        end = next(_heard(said, end, (word,)), None) if end is not None else None
    return end
