from __future__ import annotations

import pytest
from pydantic import ValidationError

from dfdbench.system.record import Record


class Shelf(Record):
    books: int
    names: list[str] = []


def test_a_record_is_frozen_and_refuses_what_it_does_not_know() -> None:
    shelf = Shelf(books=3)
    with pytest.raises(ValidationError, match="frozen"):
        shelf.books = 4  # type: ignore[misc]
    with pytest.raises(ValidationError, match="Extra inputs"):
        Shelf.model_validate({"books": 3, "boks": 3})
