"""A page a method, of its card, of the code's own description and of its rows on the board."""

from __future__ import annotations

import importlib
import inspect
import json
import re
import shlex
from collections.abc import Iterator
from typing import Any

import pandas as pd
from board import PICTURES, command_of

from dfdbench.blur.tracks import CLEAN
from dfdbench.board.board import Board
from dfdbench.board.cards import Card
from dfdbench.board.tables import link_to
from dfdbench.methods.registry import find_entry, method_words
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import title_of
from dfdbench.metrics.regions import REGIONS
from dfdbench.results.frame import group_means
from dfdbench.results.wording import NOTHING, score_text, seconds_text
from dfdbench.tables.render import as_markdown, escape_markdown
from dfdbench.tables.table import Link, Table, listed

INDEX = """---
description: Every method on the board with a picture of what it gives, its paper and parameters.
---

# All methods

What each makes of one pair of the demo set, *Kitchen*, bright is near. A method that takes focal
stacks alone has the same view as a stack of nine. To add yours: [submit a result](../submit.md).
The pictures are drawn by `python docs/site/pictures.py methods`.

{views}

<div class="cards" markdown>

{cards}

</div>
"""
_VIEWS = (("infocus", "in-focus image"), ("defocus", "defocus image"), ("truth", "true depth"))
#: Where a method breaks is asked of its scores under the protocol that all sets have.
_PROTOCOL, _METRIC, _BASELINE = "valid", "nrmse", "constant"
_WORST = 6
#: What a run hands to a method unless the user does.
_FACTS = ("recipe", "recipe_name", "training_mean", "training_median", "seed", "rig")


def method_pages(board: Board) -> Iterator[tuple[str, str]]:
    """Yield the pages of the methods and their index, each with its place on the site."""
    means = _means(board)
    pairs = json.loads((PICTURES / "scores.json").read_text("utf-8"))
    cards = "\n".join(_entry(name, card) for name, card in board.cards.items())
    yield "method/index.md", INDEX.format(views=_figures(dict(_VIEWS), ""), cards=cards)
    for name, card in board.cards.items():
        yield f"method/{name}.md", _page(name, card, board, means, pairs.get(name, {}))


def _entry(name: str, card: Card) -> str:
    place = f"../assets/pictures/demo/{name}.jpg"
    shown = f"[![Depth by {name}]({place}){{ loading=lazy }}]({name}.md)" if _is_drawn(name) else ""
    return (
        f"<figure markdown>\n{shown}\n"
        f"<figcaption markdown>[**{name}**]({name}.md)<br>{escape_markdown(card.title)}"
        "</figcaption>\n</figure>\n"
    )


def _is_drawn(file: str) -> bool:
    # A method that was submitted is not.
    return (PICTURES / f"{file}.jpg").is_file()


def _figures(views: dict[str, str], prefix: str) -> str:
    shown = "\n".join(
        f"<figure markdown>\n![{words}, {prefix or 'the pair shown'}]"
        f"(../assets/pictures/demo/{file}.jpg)\n<figcaption>{words}</figcaption>\n</figure>\n"
        for file, words in views.items()
        if _is_drawn(file)
    )
    return f'<div class="views" markdown>\n\n{shown}\n</div>\n'


def _page(
    name: str, card: Card, board: Board, means: pd.Series, pair: dict[str, float | None]
) -> str:
    stack = "pair" not in card.takes
    views = {"infocus": "in-focus image"} | ({} if stack else {"defocus": "defocus image"})
    views |= {"truth": "true depth", name: "its depth", f"{name}-error": "its error"}
    given = [f"given {card.given}"]
    given += [
        f"{w} on {d}" for w, d in (("trained", card.trained_on), ("fitted", card.fitted_on)) if d
    ]
    what = method_words().get(card.entry, "")
    facts = {
        "what": escape_markdown(what),
        "authors": escape_markdown(listed(card.authors)),
        "paper": _with_doi(card.paper) if card.paper else NOTHING,
        "code": f"<{card.code}>" if "://" in card.code else f"`{card.code}`",
        "licence": escape_markdown(card.licence),
        "takes": " and ".join(f"{kind}s" for kind in card.takes),
        "given": escape_markdown("; ".join(given).removeprefix("given ")),
    }
    table = "".join(f"| {head} | {text} |\n" for head, text in facts.items() if text)
    data = "demo@stack-9" if stack else "demo"
    run = shlex.join(["dfdbench", "run", "--dataset", data, *card.arguments()])
    drawn = "as a focal stack of nine" if stack else "one pair"
    score = f", NRMSE {score_text(pair['nrmse'])}" if pair.get("nrmse") is not None else ""
    return (
        f"---\ndescription: {json.dumps(f'{name}: {card.title}. ' + what)}\n---\n\n"
        f"# {name}\n\n**{escape_markdown(card.title)}.**\n\n"
        + _figures(views, name)
        + f"\n*Kitchen of the demo set, {drawn}{score}. Error: orange is too far, purple too near.*"
        f"\n\n| | |\n|:---|:---|\n{table}\n```\n{run}\n```\n"
        + _parameters(card)
        + _breaks(name, card, means, pair)
        + _rows(name, card, board)
    )


def _with_code(text: str) -> str:
    return escape_markdown(text).replace("\\`", "`")


def _with_doi(paper: str) -> str:
    text = escape_markdown(paper)
    return re.sub(r"doi (10\.[^\s;,]+)", r"doi [\1](https://doi.org/\1)", text)


def _parameters(card: Card) -> str:
    """Return the parameters with their defaults and what the code says of each."""
    if "://" in card.code:
        return ""
    place, _, attribute = find_entry(card.entry).partition(":")
    target = getattr(importlib.import_module(place), attribute)
    told = parameters_of(target)
    rows = []
    for key, parameter in inspect.signature(target).parameters.items():
        shown = "the data set's" if key in _FACTS else f"`{parameter.default}`"
        if key in card.parameters:
            shown += f", here {escape_markdown(str(card.parameters[key]))}"
        rows.append(f"| `{key}` | {shown} | {_with_code(told.get(key, ''))} |")
    if not rows:
        return "\n## Parameters\n\nNone.\n"
    head = "| parameter | default | what |\n|:---|:---|:---|\n"
    return f"\n## Parameters\n\n`--param NAME=VALUE` sets one.\n\n{head}" + "\n".join(rows) + "\n"


def parameters_of(target: Any) -> dict[str, str]:
    """Return what is said of each parameter, by the class or by its like in the same module.

    A class that says nothing of its own is itself described.
    """
    summary = inspect.cleandoc(target.__doc__ or "").partition("\n\n")[0]
    found = dict.fromkeys(inspect.signature(target).parameters, " ".join(summary.split()))
    members = inspect.getmembers(inspect.getmodule(target), inspect.isclass)
    others = (each for _, each in members if each.__module__ == target.__module__)
    for one in (*others, target):
        found |= {key: words for key, words in _documented(one).items() if key in found}
    return found


def _documented(target: Any) -> dict[str, str]:
    """Return the parameters of a NumPy docstring with their descriptions, a line each."""
    text = inspect.cleandoc(target.__doc__ or "")
    section = re.search(r"^Parameters\n-+\n(.*?)(?=^\w[\w ]*\n-+\n|\Z)", text, re.M | re.S)
    entry = re.compile(r"^(\w+(?:, \w+)*)(?: :[^\n]*)?\n((?:[ ]+[^\n]*\n?|\n)*)", re.M)
    return {
        name: " ".join(words.split()).replace("``", "`")
        for names, words in entry.findall(section[1] if section else "")
        for name in names.split(", ")
    }


def _means(board: Board) -> pd.Series:
    scores = board.scores
    own = scores[(scores["protocol"] == _PROTOCOL) & (scores["metric"] == _METRIC)]
    return group_means(own, "method", "dataset", "split", "track", "severity")


def _breaks(name: str, card: Card, means: pd.Series, pair: dict[str, float | None]) -> str:
    """Return where a method does worst, against the constant on the same images."""
    text = f"{escape_markdown(card.limits)}\n\n" if card.limits else ""
    if parts := [f"{region} {score_text(pair[region])}" for region in REGIONS if region in pair]:
        text += f"On the pair above, NRMSE by region: {', '.join(parts)}.\n\n"
    if name not in means.index.get_level_values("method"):
        return f"\n## Where it breaks\n\n{text}It has no row on the board yet.\n"
    own, floor = means.loc[name].dropna(), means.loc[_BASELINE]
    shares = (own / floor.reindex(own.index)).dropna().sort_values(ascending=False)
    if name == _BASELINE or shares.empty:
        return f"\n## Where it breaks\n\n{text}" if text else ""
    rows = tuple(
        (_place(*at), score_text(own[at]), score_text(floor[at]), f"{shares[at]:.2f}")
        for at in shares.index[:_WORST]
    )
    lost = int((shares >= 1).sum())
    said = f"no better on {lost}" if lost else "better on all"
    columns = ("where", "NRMSE ↓", "a constant's", "share")
    table = Table("", columns, rows, "lrrr")
    return (
        f"\n## Where it breaks\n\n{text}Beside a constant depth map on the same sets "
        f"and tracks, {len(shares)} in all (protocol `{_PROTOCOL}`), it is {said}. The worst:\n\n"
        + as_markdown(table).partition("\n\n")[2]
    )


def _place(dataset: str, split: str, track: str, severity: int) -> str:
    return f"{dataset}{'' if track == CLEAN else f'@{track}-{severity}'}, {split}"


def _rows(name: str, card: Card, board: Board) -> str:
    """Return a method's headline rows, with the files of their scores and their commands."""
    rows, commands = [], []
    for one in board.boards:
        for at, standing in enumerate(one.standings):
            if standing.entry.label != name or not (one.headline or one.suite != CLEAN):
                continue
            data = one.result.dataset
            rank = NOTHING if standing.rank is None else f"{standing.rank} of {len(one.standings)}"
            suite = "" if one.suite == CLEAN else f", {one.suite}"
            link = Link(
                f"{data.label}, {data.split}{suite}", link_to(standing.entry.path, board.folder)
            )
            metric = find_metric(one.metric)
            rows.append(
                (
                    link,
                    title_of(one.protocol),
                    rank,
                    f"{metric.heading} {one.shown(at, one.metric)}",
                    seconds_text(standing.entry.seconds),
                )
            )
            commands.append(command_of(standing.entry, one.suite, card))
    if not rows:
        return ""
    table = Table(
        "", ("row", "protocol", "rank", "score", "seconds per pair"), tuple(rows), "lllrr"
    )
    text = as_markdown(table).partition("\n\n")[2].replace("](results/", "](../board/results/")
    listing = "\n".join(commands)
    return (
        "\n## Its rows\n\nEach opens its file of scores. "
        f"[The board](../board/index.md?method={name}) compares them.\n\n{text}\n"
        f"Made by, after `dfdbench build` of each set:\n\n```\n{listing}\n```\n"
    )
