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


def told(content: dict[str, object]) -> list[tuple[str, str, str, str]]:
    with pytest.raises(ValidationError) as caught:
        Shelf.model_validate(content)
    problems = problems_of(caught.value, "off", file="f.json", fix="mend it")
    assert {problem.fix for problem in problems} == {"mend it"}
    return [(each.what, each.where, each.expected, each.got) for each in problems]


def test_every_refused_field_is_a_problem() -> None:
    assert told({"names": ["a", 7], "boks": 2}) == [
        ("field is missing", "f.json: books", "", ""),
        ("off", "f.json: names[1]", "text", "7"),
        ("unknown field", "f.json: boks", "", "2"),
    ]
    assert told({"books": 0, "names": ["a"]}) == [("off", "f.json", "fewer books than names", "")]
