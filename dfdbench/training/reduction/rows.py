"""From counts to networks: the ensemble rows B and the iterative rows F of Table D.2."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Literal

from dfdbench.blur.recipe import LEVELS as DEPTH_LEVELS
from dfdbench.errors import InputError
from dfdbench.methods.networks.widths import LAYERS
from dfdbench.tables.table import Table
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.reduction.counts import STATISTICS, Counts, Statistic

Widths = tuple[int, ...]
Rounding = Literal["H", "L"]
#: Layers that are added to each other are equally wide.
TIED = ((52, 45), (42, 37), (34, 29), (24, 17), (12, 5))
#: The layers of each level; in the last stage 27 is counted again, as Table D.2 has it.
LEVELS: Mapping[int, tuple[int, ...]] = {
    1: (52, 48, 45, 15, 12, 8, 5),
    2: (42, 40, 37, 27, 24, 20, 17),
    3: (34, 32, 29, 27),
}
_MULTIPLE = 8
# How Table D.2 numbers them, as far as its widths tell.
_ENSEMBLE: tuple[Statistic, ...] = ("min", "mean", "max")
_ITERATIVE: tuple[Statistic, ...] = ("min", "max", "mean")


def ensemble_rows(counts: Mapping[Statistic, Mapping[int, int]]) -> dict[str, Widths]:
    """Return the widths of B-01-01 to B-03-03, input to output: all layers are cut at once.

    The rule is not in the thesis; it is inferred from Tables D.1 and D.2 and gives all nine rows
    of the latter from the former. The first number is the statistic over the samples: minimum,
    mean, maximum. The second says what layers that are added to each other take: the smaller count,
    the larger, or the larger with layer 2's count for layers 12 and 5.

    Parameters
    ----------
    counts : mapping
        Of each statistic, the counts by layer; layer 1 stays as wide as it is, 256.

    Examples
    --------
    >>> every = dict.fromkeys((*LAYERS[:-1], 2), 30) | {12: 20, 2: 10}
    >>> rows = ensemble_rows({"min": every, "mean": every, "max": every})
    >>> [rows[name][14:17] for name in ("B-01-01", "B-01-02", "B-01-03")]
    [(20, 30, 20), (30, 30, 30), (10, 30, 10)]
    """
    return {
        f"B-0{number}-0{choice}": _row(dict(counts[statistic]), choice)
        for number, statistic in enumerate(_ENSEMBLE, 1)
        for choice in (1, 2, 3)
    }


def iterative_rows(
    counts: Mapping[Statistic, Mapping[int, int]], level: int, base: Sequence[int]
) -> dict[str, Widths]:
    """Return the widths to try on one level; all other layers stay as they are (6.2).

    Levels follow each other: of level 1's rows the best is trained from scratch, level 2 is counted
    on it, and so on. The rows of level 3 are F-01-01 to F-03-02, numbered as in Table D.2: minimum,
    maximum, mean; the smaller, the larger. Those of earlier levels, which the thesis does not name,
    are F1-... and F2-....

    Parameters
    ----------
    counts : mapping
        Of each statistic, the counts by layer, on the network of `base`.
    level : int
        1 to 3.
    base : sequence of int
        The widths of that network, input to output.

    Raises
    ------
    InputError
        Where there is no such level.
    """
    if level not in LEVELS:
        raise InputError("no such level", where="level", expected="1, 2 or 3", got=str(level))
    before = dict(zip(LAYERS, base, strict=True))
    prefix = "F" if level == max(LEVELS) else f"F{level}"
    rows = {}
    for number, statistic in enumerate(_ITERATIVE, 1):
        # Layer 2 tells the width of 12 and 5, which are of level 1.
        for choice in (1, 2, 3) if level == 1 else (1, 2):
            full = dict(zip(LAYERS, _row(dict(counts[statistic]), choice), strict=True))
            chosen = before | {layer: full[layer] for layer in LEVELS[level]}
            rows[f"{prefix}-0{number}-0{choice}"] = tuple(chosen[layer] for layer in LAYERS)
    return rows


def rounded(rows: Mapping[str, Widths], rounding: Rounding) -> dict[str, Widths]:
    """Return rows rounded to multiples of 8, up (H) or down (L, to no less than 8); layer 1 stays.

    H gives F-02-02H from F-02-02. F-02-02L is called rounded down in the thesis and printed mixed:
    L does what it is called.

    Examples
    --------
    >>> row = {"F-9": (*[45] * 17, 256)}
    >>> rounded(row, "H")["F-9H"][0], rounded(row, "L")["F-9L"][0]
    (48, 40)
    """

    def to_multiple(width: int) -> int:
        up = width + _MULTIPLE - 1 if rounding == "H" else width
        return max(1, up // _MULTIPLE) * _MULTIPLE

    return {
        f"{name}{rounding}": (*map(to_multiple, widths[:-1]), widths[-1])
        for name, widths in rows.items()
    }


def _row(counts: dict[int, int], choice: int) -> Widths:
    for one, other in TIED:
        chosen = (min if choice == 1 else max)(counts[one], counts[other])
        counts[one] = counts[other] = chosen
    if choice == 3:
        counts[12] = counts[5] = counts[2]
    return (*(counts[layer] for layer in LAYERS[:-1]), DEPTH_LEVELS)


def rows_of(counts: Counts, base: Sequence[int], level: int | None) -> dict[str, Widths]:
    """Return the rows that counts give: the ensemble's, or the iterative ones of a level."""
    by_statistic: dict[Statistic, dict[int, int]] = {
        statistic: counts.widths(statistic) for statistic in STATISTICS
    }
    return iterative_rows(by_statistic, level, base) if level else ensemble_rows(by_statistic)


def rows_table(rows: Mapping[str, Widths], parameters: Mapping[str, int], title: str) -> Table:
    """Return rows in the form of Table D.2, with the parameters that each network has."""
    lines = tuple(
        (name, *map(str, widths), f"{parameters[name]:,}") for name, widths in rows.items()
    )
    columns = ("name", *map(str, LAYERS), "parameters")
    return Table(title, columns, lines, "l" + "r" * (len(LAYERS) + 1))


def as_toml(configuration: TrainingConfiguration, widths: Widths, comment: str) -> str:
    """Return the text of a configuration that trains a network of these widths, and says why.

    Examples
    --------
    >>> print(as_toml(TrainingConfiguration(narrow=8), (4, 256), "of mine").splitlines()[2])
    filters = [4, 256]
    """
    others = configuration.model_dump(mode="json", exclude_none=True, exclude={"filters", "narrow"})
    choices = {"filters": list(widths), "narrow": 1, **others}
    # What JSON writes of texts, numbers and lists of them, TOML reads alike.
    lines = [f"{name} = {json.dumps(value)}" for name, value in choices.items()]
    return "\n".join([f"# {comment}", "", *lines, ""])
