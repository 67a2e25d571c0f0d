"""A file that is JSON has the tree that YAML gives it, places included; what is not plainly
JSON is left to YAML.
"""

import json
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from cellwright.kb.diagnostics import InvalidInput
from cellwright.kb.files import File, find_unprintable
from cellwright.kb.loader.yaml_tree import MAX_NODES, Composer, YamlNode, json_tree, read_tree

words = st.text(st.sampled_from('ab "\\/,:{}[]#-\n\té~'), max_size=6)
values = st.recursive(
    words | st.integers() | st.floats(allow_nan=False) | st.booleans() | st.none(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(words, inner, max_size=3),
)
forms = st.sampled_from(
    [{"indent": 1}, {}, {"indent": 0}, {"separators": (",", ":")}, {"ensure_ascii": False}]
)


def composed(file: File) -> YamlNode | None:
    """The tree by YAML; None if YAML has something to say."""
    found: list[Any] = []
    try:
        tree = Composer(file, found, MAX_NODES).compose()
    except (yaml.YAMLError, InvalidInput):
        return None
    return None if found else tree


@given(st.dictionaries(words, values, max_size=4), forms)
def test_a_tree_is_that_of_yaml(content: dict[str, Any], form: dict[str, Any]) -> None:
    file = File.of("file", json.dumps(content, **form))
    if find_unprintable(file.text):
        return
    quick = json_tree(file, MAX_NODES)
    if quick is not None:
        assert quick == composed(file)


@given(
    st.text(st.sampled_from('{}[]",: \n\t-1.e+atrue\\#"'), max_size=14).map(lambda text: "{" + text)
)
def test_a_text_like_json_is_read_as_yaml_reads_it(text: str) -> None:
    file = File.of("file", text)
    quick = json_tree(file, MAX_NODES)
    if quick is not None:
        assert quick == composed(file)


def test_an_answer_is_plainly_json() -> None:
    text = json.dumps(
        {"version": 1, "data": {"steps": [{"id": 1, "operator": 'say("a")', "after": []}]}},
        indent=1,
    )
    assert json_tree(File.of("file", text), MAX_NODES) == composed(File.of("file", text))


@pytest.mark.parametrize(
    "text",
    [
        '{"a": 1, "a": 2}',
        '{"a": "\\u0041"}',
        '{"a":1}',
        "{" + '"a": [' * 60 + "]" * 60 + "}",
        "a: 1",
        "{a: 1}",
        '{"a": 1',
    ],
)
def test_what_is_not_plainly_json_is_left_to_yaml(text: str) -> None:
    assert json_tree(File.of("file", text), MAX_NODES) is None


def test_a_file_with_too_many_values_is_refused() -> None:
    file = File.of("file", json.dumps({"a": list(range(20))}))
    with pytest.raises(InvalidInput, match="more than 10 values"):
        read_tree(file, 10)
