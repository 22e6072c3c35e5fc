from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import Field, ValidationError

from wiclosure.errors import ConfigError
from wiclosure.pipeline.runtime.settings_text import explain, merged_settings, nest, nested_words
from wiclosure.settings import Settings


class Wheel(Settings):
    radius_m: float = Field(0.3, gt=0)
    spokes: int = 7


class Cart(Settings):
    wheel: Wheel = Wheel()
    name: str = "cart"


trees = st.recursive(
    st.integers(), lambda inner: st.dictionaries(st.sampled_from("abc"), inner, max_size=3), max_leaves=8
).filter(lambda tree: isinstance(tree, dict))


@pytest.mark.parametrize(
    ("words", "nested"),
    [
        (["a=1"], {"a": 1}),
        (["a.b=1", "a.c=[x, 2]"], {"a": {"b": 1, "c": ["x", 2]}}),
        (["a.b=1", "a.b=2.5"], {"a": {"b": 2.5}}),
        (["a=1", "a.b=2"], {"a": {"b": 2}}),
        (["path=08.txt", "none=null", "equals=x=y"], {"path": "08.txt", "none": None, "equals": "x=y"}),
        (["brackets=[1"], {"brackets": "[1"}),
        ([], {}),
    ],
)
def test_words_become_nested_keys(words: list[str], nested: dict[str, Any]) -> None:
    assert nested_words(words, "--set") == nested


@pytest.mark.parametrize("word", ["a", "=1", ""])
def test_other_words_are_refused(word: str) -> None:
    with pytest.raises(ConfigError, match=r"^--set .*expected key\.path=value$"):
        nested_words([word], "--set")


def test_a_value_lies_below_all_its_keys() -> None:
    assert nest(["a", "b", "c"], "1") == {"a": {"b": {"c": 1}}}


@given(trees, trees, trees)
def test_layers_can_be_merged_in_any_grouping(a: dict[str, Any], b: dict[str, Any], c: dict[str, Any]) -> None:
    assert merged_settings(a, a) == merged_settings(a, {}) == merged_settings({}, a) == a
    assert merged_settings(merged_settings({}, a), b) == merged_settings(a, b)
    assert set(merged_settings(merged_settings(a, b), c)) == set(a) | set(b) | set(c)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ({"wheel": {"spoke": 3}}, "unknown configuration key wheel.spoke in f; did you mean wheel.spokes?"),
        ({"wheel": {"xyz": 3}}, "unknown configuration key wheel.xyz in f; known here: radius_m, spokes"),
        ({"wheels": 3}, "unknown configuration key wheels in f; did you mean wheel?"),
        ({"wheel": {"radius_m": -1}}, "configuration wheel.radius_m = -1 in f: input should be greater than 0"),
        ({"wheel": 3}, "configuration wheel = 3 in f: expected keys with values (see wiclosure dump-config)"),
    ],
)
def test_the_first_problem_is_one_sentence(content: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValidationError) as caught:
        Cart.model_validate(content)
    assert explain(caught.value, "f", Cart) == sentence
