import pytest

from dfdbench.errors import MethodError
from dfdbench.methods.signature import check_parameters, is_class, parameters_of


class Takes:
    def __init__(self, window: int, recipe: object = None) -> None:
        pass


class Lies:
    __class__ = property(lambda self: 1 / 0)


def test_what_something_is_does_not_depend_on_what_it_says() -> None:
    assert is_class(Takes)
    assert not is_class(Lies())
    assert parameters_of(Takes) == {"window", "recipe"}


def test_what_is_unknown_and_what_is_needed_is_named() -> None:
    check_parameters("m:Takes", Takes, {"window": 3})
    with pytest.raises(MethodError, match="unknown parameter") as told:
        check_parameters("m:Takes", Takes, {"window": 3, "widnow": 4, "wind": 5})
    assert [problem.got for problem in told.value.problems] == ["widnow", "wind"]
    with pytest.raises(MethodError, match="parameter is needed") as told:
        check_parameters("m:Takes", Takes, {})
    assert told.value.problems[0].fix == "--param window=VALUE"


def test_a_callable_that_does_not_tell_takes_what_it_is_given() -> None:
    class Silent:
        @property
        def __signature__(self) -> None:
            raise RuntimeError("boom")

        def __call__(self) -> None:
            pass

    assert parameters_of(Silent()) == set()
    check_parameters("m:s", Silent(), {"anything": 1})
