"""Cards of methods: who wrote a method, where its code is, and what it is given."""

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, JsonValue, TypeAdapter, ValidationError, model_validator

from dfdbench.datasets.manifest import Name
from dfdbench.errors import Problem, ResultError, reason_of
from dfdbench.methods.registry import built_in_methods, registered_methods
from dfdbench.results.record import Line
from dfdbench.results.wording import NOTHING, plain
from dfdbench.system.files import read_text
from dfdbench.system.strict import StrictRecord, problems_of
from dfdbench.system.text import parse_toml
from dfdbench.tables.table import Link, Table, listed

METHODS = "methods"
WRITE_CARD = "write one, NAME.toml: title, authors, code, licence, entry, parameters and given"
_NAME = TypeAdapter[str](Name)
Takes = Literal["pair", "stack"]


class Card(StrictRecord):
    """How to run a method of the leaderboard and what to show of it.

    `entry` is what follows ``--method``, or the name of handed-in depth maps; `parameters` are the
    ``--param``. `code` is an address, or a file of this repository. `given` says what the method
    gets besides the images, `trained_on` and `fitted_on` what it learns from, `limits` where it
    breaks. `takes` says what it is run on: pairs, stacks or both. With `given_blur`, it is run on
    tracks with ``--given-blur``.
    """

    title: Line
    authors: Annotated[list[Line], Field(min_length=1)]
    paper: Line | None = None
    code: Annotated[Line, Field(pattern=r"^(https?://|dfdbench/)[^\s<>|]+$")]
    licence: Line
    entry: Line
    parameters: dict[str, JsonValue] = Field(default_factory=dict)
    given: Line
    trained_on: Line | None = None
    fitted_on: Line | None = None
    takes: Annotated[list[Takes], Field(min_length=1)] = Field(default=["pair"])
    given_blur: bool = False
    limits: Line | None = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        # The site shows a command of one line.
        if not all(word.isprintable() for word in self.arguments()):
            raise ValueError("entry and parameters are to be printable, in one line")
        return self

    def arguments(self, on_tracks: bool = False) -> list[str]:
        """Return the method's command-line arguments after ``run`` or ``tracks``."""
        settings = [f"--param={name}={plain(value)}" for name, value in self.parameters.items()]
        given = ["--given-blur"] * (self.given_blur and on_tracks)
        return ["--method", self.entry, *settings, *given]

    def is_of(self, name: str, entry: str, parameters: Mapping[str, Any]) -> bool:
        """Return whether the card describes a method of this name, entry and parameters."""
        return self.entry in (name, entry) and self.parameters == parameters


def load_cards(folder: Path) -> dict[str, Card]:
    """Read a leaderboard's cards, by name.

    Raises
    ------
    ResultError
        With everything that is wrong in any of them, or if two have the same name or method.
    """
    cards: dict[str, Card] = {}
    problems: list[Problem] = []
    for path in sorted((folder / METHODS).glob("*.toml")):
        try:
            _NAME.validate_python(path.stem)
            cards[path.stem] = Card.model_validate(parse_toml(read_text(path)))
        except ValidationError as error:
            problems += problems_of(error, "wrong value in the card", file=path)
        except (OSError, ValueError) as error:
            problems.append(Problem(f"cannot read the card: {reason_of(error)}", where=str(path)))
        built_in = built_in_methods().get(path.stem)
        if path.stem in cards and built_in and cards[path.stem].entry not in (path.stem, built_in):
            what = f"the name is that of our own {path.stem}, and the entry another method's"
            problems.append(Problem(what, where=str(path), fix="give the card another name"))
    for (one, first), (other, second) in combinations(cards.items(), 2):
        where = listed([f"{folder / METHODS / name}.toml" for name in (one, other)])
        if one.casefold() == other.casefold():
            problems.append(Problem("two cards of one name", where=where, fix="rename one"))
        elif _method_of(first) == _method_of(second):
            problems.append(Problem("two cards of one method", where=where, fix="remove one"))
    ResultError.raise_if(problems)
    return cards


def _method_of(card: Card) -> tuple[str, Mapping[str, Any], bool]:
    """Return what tells a card's method from others, whether its entry is a name or a place."""
    name = card.entry
    # Asking what packages offer takes a while, and no package takes a built-in name.
    entry = name if ":" in name else built_in_methods().get(name) or registered_methods().get(name)
    return entry or name, card.parameters, card.given_blur


def cards_table(cards: Mapping[str, Card], in_repository: bool) -> Table:
    """Return a table of who wrote the methods, where their code is, and what they are given.

    Files of this repository are linked only from within it.
    """
    rows = []
    for name, card in cards.items():
        learned = (("trained on", card.trained_on), ("fitted on", card.fitted_on))
        given = [card.given, *(f"{verb} {data}" for verb, data in learned if data)]
        ours = "://" not in card.code
        linked = Link(name, f"../{card.code}" if ours else card.code)
        facts = (card.title, listed(card.authors), card.paper or NOTHING, card.licence)
        rows.append((name if ours and not in_repository else linked, *facts, "; ".join(given)))
    columns = ("method and its code", "title", "authors", "paper", "licence", "given")
    return Table("methods", columns, tuple(rows), "l" * len(columns))


def find_card(
    folder: Path,
    name: str,
    entry: str,
    parameters: Mapping[str, Any],
    given_blur: bool | None = None,
) -> str:
    """Return the name of a method's card.

    Parameters
    ----------
    folder : Path
        The leaderboard's folder.
    name, entry, parameters
        The method's, as a result records them.
    given_blur : bool, optional
        Whether it was given a blur on tracks; None if not yet known.

    Raises
    ------
    ResultError
        If the method has no card.
    """
    for found, card in load_cards(folder).items():
        if card.is_of(name, entry, parameters) and given_blur in (None, card.given_blur):
            return found
    shown = " ".join([name, *(f"{key}={value}" for key, value in parameters.items())])
    what = f"{shown}{', given the blur,' * bool(given_blur)} has no card"
    raise ResultError(what, where=str(folder / METHODS), fix=WRITE_CARD)
