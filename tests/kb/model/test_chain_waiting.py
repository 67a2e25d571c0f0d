"""Chains that wait for others, and no more for those that are gone."""

from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.model.planning_problem import Chain

NAMES = st.lists(st.sampled_from("abcdef"), unique=True)


@given(after=NAMES, names=NAMES)
def test_a_chain_waits_only_for_what_is_named_in_its_own_order(
    after: list[str], names: list[str]
) -> None:
    chain = Chain("own", (), tuple(after))
    cut = chain.wait_only_for(names)
    assert set(cut.after) == set(after) & set(names)
    assert sorted(cut.after, key=after.index) == list(cut.after)
    assert cut.wait_only_for(after) == cut
    assert (cut.name, cut.stages, cut.subject) == (chain.name, chain.stages, chain.subject)
