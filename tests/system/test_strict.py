from __future__ import annotations

import pytest
from pydantic import Field, ValidationError, model_validator

from dfdbench.system.strict import Record, problems_of


class Shelf(Record):
    books: int
    names: list[str] = Field(min_length=1)

    @model_validator(mode="after")
    def _adds_up(self) -> Shelf:
        if self.books < len(self.names):
            raise ValueError("fewer books than names")
        return self


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ({"names": ["a"]}, [("field is missing", "f.json: books", "", "")]),
        (
            {"books": "x", "names": ["a", 7]},
            [
                ("off", "f.json: books", "a whole number", "'x'"),
                ("off", "f.json: names[1]", "text", "7"),
            ],
        ),
        ({"books": 3, "names": []}, [("off", "f.json: names", "have at least 1 item", "[]")]),
        ({"books": 0, "names": ["a"]}, [("off", "f.json", "fewer books than names", "")]),
        ({"books": 1, "names": ["a"], "boks": 2}, [("unknown field", "f.json: boks", "", "2")]),
    ],
)
def test_every_refused_field_is_a_problem(
    content: dict[str, object], said: list[tuple[str, str, str, str]]
) -> None:
    with pytest.raises(ValidationError) as caught:
        Shelf.model_validate(content)
    problems = problems_of(caught.value, "off", file="f.json", fix="mend it")
    assert len(problems) == len(said)
    for problem, (what, where, expected, got) in zip(problems, said, strict=True):
        assert (problem.what, problem.where, problem.got) == (what, where, got)
        assert problem.expected.startswith(expected)
        assert problem.fix == "mend it"
