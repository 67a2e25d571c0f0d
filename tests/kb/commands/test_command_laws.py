"""Laws of commands: sentences that say the same mean the same."""

import itertools

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwright.kb.commands import understand_command
from cellwright.kb.commands.domain_nouns import NounVocabulary
from cellwright.kb.commands.phrase_meanings import read_meanings
from cellwright.kb.commands.phrase_patterns import PatternWord, expand_pattern
from cellwright.kb.commands.sentence import book_of
from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.loader import load_domain
from cellwright.kb.model.planning_problem import Problem
from cellwright.kb.terms import Number

unhurried = settings(deadline=None, max_examples=25)

THEMSE = load_domain("themse")
NUMBERS = st.integers(1, 4)
LISTS = st.lists(NUMBERS, min_size=1, max_size=4, unique=True)


def meaning(sentence: str) -> Problem:
    return understand_command(THEMSE, sentence)


def listed(numbers: list[int], last: str = " and ") -> str:
    *first, final = map(str, numbers)
    return f"{', '.join(first)}{last}{final}" if first else final


def heated_seconds(time_said: str) -> int:
    (chain,) = meaning(f"heat probe 1 for {time_said}").chains
    (stage,) = chain.stages
    assert isinstance(stage.arguments[1], Number)
    return stage.arguments[1].value


@unhurried
@given(LISTS.flatmap(lambda numbers: st.tuples(st.just(numbers), st.permutations(numbers))))
def test_the_order_of_a_list_only_says_who_is_named_first(
    lists: tuple[list[int], list[int]],
) -> None:
    sentence = "process probes {} for 15 min, cool them for 5 min and store them again"
    one, other = (meaning(sentence.format(listed(numbers))) for numbers in lists)
    assert set(one.chains) == set(other.chains)
    assert [str(chain.subject) for chain in other.chains] == [
        f"probe_{number}" for number in lists[1]
    ]
    assert one.goal == other.goal


@unhurried
@given(NUMBERS, NUMBERS, st.sampled_from([" to ", "-", "..", " - ", " ... "]))
def test_a_range_is_the_list_of_what_it_counts(one: int, other: int, mark: str) -> None:
    low, high = sorted((one, other))
    written_out = meaning(f"heat probes {listed(list(range(low, high + 1)))} for 5 min")
    assert meaning(f"heat probes {low}{mark}{high} for 5 min") == written_out


@unhurried
@given(LISTS, st.sampled_from([" and ", ", and ", ", ", " & "]))
def test_commas_and_conjunctions_join_lists_alike(numbers: list[int], last: str) -> None:
    assert meaning(f"heat probes {listed(numbers, last)} for 5 min") == meaning(
        f"heat {listed([f'probe {number}' for number in numbers])} for 5 min"
    )


@unhurried
@given(
    LISTS,
    st.sampled_from(
        [", ", " and ", ", and ", " then ", ", then ", " and then ", "; ", ". ", ". Then "]
    ),
)
def test_acts_of_the_same_probes_follow_each_other_however_joined(
    numbers: list[int], join: str
) -> None:
    said = meaning(
        f"heat probes {listed(numbers)} for 5 min{join}store "
        f"{'it' if len(numbers) == 1 else 'them'}"
    )
    assert {(str(c.subject), c.after, tuple(map(str, c.stages))) for c in said.chains} == {
        (f"probe_{n}", (), (f"heated(probe_{n}, 300)", f"stored(probe_{n})")) for n in numbers
    }


@unhurried
@given(st.data())
def test_capitals_and_articles_mean_nothing(data: st.DataObject) -> None:
    sentence = "process probes 1 and 2 in the furnace for 15 min, then store them"
    words = [
        data.draw(st.sampled_from([word, word.title(), word.upper()])) for word in sentence.split()
    ]
    said = " ".join(word for word in words if word.lower() != "the" or data.draw(st.booleans()))
    assert meaning(said) == meaning(sentence)


@pytest.mark.slow
@unhurried
@given(st.integers(1, 10_000))
def test_units_of_time_agree(seconds: int) -> None:
    hours, rest = divmod(seconds, 3600)
    minutes, left = divmod(rest, 60)
    pieces = [(hours, "h"), (minutes, "min"), (left, "s")]
    said = " ".join(f"{amount} {unit}" for amount, unit in pieces if amount)
    assert (
        heated_seconds(said)
        == heated_seconds(f"{seconds} s")
        == heated_seconds(f"{seconds}s")
        == seconds
    )


def test_times_in_words() -> None:
    assert heated_seconds("an hour") == heated_seconds("1 hour") == heated_seconds("60 minutes")
    assert heated_seconds("a quarter of an hour") == heated_seconds("15 minutes") == 900
    assert heated_seconds("three quarters of an hour") == 2700
    assert heated_seconds("half an hour") == heated_seconds("0.5 h") == 1800
    assert heated_seconds("two minutes and ten seconds") == 130


@unhurried
@given(
    st.lists(
        st.tuples(NUMBERS, st.sampled_from(["heat", "cool"]), st.booleans()), min_size=1, max_size=6
    )
)
def test_the_order_of_a_sentence_is_honoured(acts: list[tuple[int, str, bool]]) -> None:
    """Acts of one probe in the order said; after "then", another probe waits for all that was
    said before.
    """
    said = ""
    groups: list[list[tuple[str, int]]] = []
    for index, (probe, verb, then) in enumerate(acts):
        join = "" if index == 0 else (", then " if then else " and ")
        said += f"{join}{verb} probe {probe} for {index + 1} min"
        if index == 0 or then:
            groups.append([])
        groups[-1].append((f"probe_{probe}", index + 1))
    before = _stage_order(meaning(said))
    flat = [act for group in groups for act in group]
    for (one, first), (other, second) in itertools.combinations(flat, 2):
        assert one != other or (first, second) in before
    for index, group in enumerate(groups[1:], 1):
        previous = {probe for probe, _ in groups[index - 1]}
        for probe, act in group:
            if probe not in previous:
                earlier = [number for each in groups[:index] for _, number in each]
                assert all((number, act) in before for number in earlier), said
    for group in groups[:1]:
        assert not any(
            (a, b) in before for (p, a), (q, b) in itertools.permutations(group, 2) if p != q
        )


def _stage_order(problem: Problem) -> set[tuple[int, int]]:
    """Pairs of acts, numbered by their minutes, of which the first must end before the second."""
    numbers = {
        chain.name: [_minutes(stage.arguments[1]) for stage in chain.stages]
        for chain in problem.chains
    }
    behind: dict[str, set[int]] = {}
    pairs: set[tuple[int, int]] = set()
    for chain in problem.chains:
        earlier = {n for name in chain.after for n in (*behind[name], *numbers[name])}
        behind[chain.name] = earlier
        pairs |= {(n, m) for n in earlier for m in numbers[chain.name]}
        pairs |= set(itertools.combinations(numbers[chain.name], 2))
    return pairs


def _minutes(term: object) -> int:
    assert isinstance(term, Number)
    return term.value // 60


def test_every_phrase_of_the_bundled_cells_can_begin_a_sentence() -> None:
    for name in ("themse", "bulkhead"):
        domain = load_domain(name)
        known = read_meanings(domain)
        book = book_of(known, NounVocabulary(domain, domain.objects))
        assert len(known) == len(domain.phrases)
        assert book.natural.words


WORDS = sorted(
    {
        part.text
        for m in read_meanings(THEMSE)
        for each in expand_pattern(m.pattern)
        for part in each
        if isinstance(part, PatternWord)
    }
)
WORDS += [
    "and",
    "then",
    "to",
    "all",
    "both",
    "each",
    "it",
    "them",
    "after",
    "before",
    "probe",
    "probes",
    "other",
    "except",
    "not",
]
SOUP = st.lists(
    st.sampled_from(
        [*WORDS, "1", "2", "7", "5 min", ",", ".", "-", "probe_1", "drawer", "xyz", "%"]
    )
)


@settings(deadline=None, max_examples=40)
@given(st.one_of(st.text(max_size=60), SOUP.map(" ".join)))
def test_any_text_is_understood_or_explained_at_its_place(text: str) -> None:
    try:
        meaning(text)
    except InvalidInput as error:
        for found in error.diagnostics:
            lines = text.split("\n")
            assert found.message
            assert 1 <= found.where.line <= len(lines)
            assert 1 <= found.where.column <= len(lines[found.where.line - 1]) + 1


def test_a_long_sentence_is_read_as_a_short_one() -> None:
    numbers = listed([1, 2, 3, 4] * 50)
    assert meaning(f"heat probes {numbers} for 5 min") == meaning("heat all probes for 5 min")
