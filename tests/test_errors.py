from __future__ import annotations

import inspect

import pytest

import wiclosure
from wiclosure import errors

ALL = [kind for _, kind in inspect.getmembers(errors, inspect.isclass)]


@pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.__name__)
def test_every_error_is_caught_by_the_root_and_carries_its_sentence(kind):
    with pytest.raises(errors.WiclosureError) as caught:
        raise kind("scans.bag: no /points topic; set lidar.topic")
    assert str(caught.value) == "scans.bag: no /points topic; set lidar.topic"


def test_the_kinds_are_disjoint():
    """A caller that handles a bad file must not swallow a bad setting, nor a mistake of the code itself."""
    kinds = [kind for kind in ALL if kind is not errors.WiclosureError]
    assert {kind.__name__ for kind in kinds} >= {"InputError", "ConfigError", "OutputError", "ProcessError"}
    for kind in kinds:
        assert kind.__bases__ == (errors.WiclosureError,)
    assert not issubclass(errors.WiclosureError, ValueError | OSError | RuntimeError)


def test_the_public_names_are_these_classes():
    for kind in ALL:
        assert getattr(wiclosure, kind.__name__) is kind


def test_errors_are_one_line_whatever_they_name():
    error = errors.InputError("a.bag holds /points (a\ntype\x1b[31m of\r\n\tlines)")
    assert str(error) == "a.bag holds /points (a type\\x1b[31m of lines)"
