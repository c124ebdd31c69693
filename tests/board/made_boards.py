"""Boards of made results, for the tests of boards and of their tables."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dfdbench.blur.tracks import CLEAN, SUITES
from dfdbench.board import cards, ranking, submission
from dfdbench.board.board import leaderboard
from dfdbench.datasets.manifest import Pair
from dfdbench.results.record import Result
from dfdbench.results.wording import knew_blur, method_label
from tests.made_results import edited, make_demo_result


def add_card(folder: Path, name: str, entry: str | None = None, **fields: Any) -> Path:
    """Write a card, in place of one of that name."""
    path = folder / f"methods/{name}.toml"
    path.parent.mkdir(parents=True, exist_ok=True)
    card = {
        "title": f"Title of {name}",
        "authors": ["Somebody"],
        "code": "https://example.org/code",
        "licence": "MIT",
        "entry": entry or name,
        "given": "nothing",
        **fields,
    }
    lines = [f"{key} = {_inline(value)}" for key, value in card.items() if value is not None]
    path.write_text("\n".join(lines) + "\n", "utf-8")
    return path


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_inline(v)}" for key, v in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)


def submit(results: Result | Sequence[Result], folder: Path) -> Path:
    """Submit runs, and write their card before if they have none."""
    runs = [results] if isinstance(results, Result) else list(results)
    method = runs[0].method
    given = any(knew_blur(run.method, run.dataset.degradation) for run in runs)
    words = [method.name, *map(str, method.parameters.values()), *["given"] * given]
    name = re.sub(r"[^A-Za-z0-9]+", "-", " ".join(words)).strip("-") or "unnamed"
    if not any(
        card.is_of(method.name, method.entry, method.parameters) and card.given_blur == given
        for card in cards.load_cards(folder).values()
    ):
        add_card(folder, name, method.name, parameters=method.parameters, given_blur=given)
    return submission.submit(results, folder)


def make_folder(*entries: str, folder: Path = Path("leaderboard")) -> None:
    """Make a leaderboard without rows, with cards of these methods."""
    (folder / "results").mkdir(parents=True)
    for entry in entries:
        add_card(folder, re.sub(r"\W+", "-", entry), entry)


def add(folder: Path, name: str, value: float, **changes: Any) -> Path:
    # Each scene leans the same way by a little more, so that intervals have a width.
    def score(pair: Pair) -> float:
        return value + 0.0001 * len(pair.scene) + 0.001 * pair.at["exposure"]

    return submit(make_demo_result(score, name, **changes), folder)


def entry_of(result: Result, path: Path) -> ranking.Entry:
    return ranking.Entry((result,), path, method_label(result.method))


def only_board(folder: Path) -> ranking.ScoreBoard:
    (board,) = leaderboard(folder).boards
    return board


def scored(name: str, value: float) -> Result:
    """Depth maps that were made elsewhere."""
    made = make_demo_result(lambda pair: value, name)
    method = {"scored": "levels", "entry": "scored, not run"}
    return edited(made, pairs={"seconds": None}, method=method)


ALL = list(SUITES["tracks-1"])


def make_tracks(
    name: str = "mine", value: float = 0.1, labels: Sequence[str] = ALL, **method: Any
) -> dict[str, Result]:
    """Runs on the demo set and on tracks of it: 0 on clean images, `value` on each track."""
    clean = make_demo_result(lambda pair: 0.0, name)
    tracked = make_demo_result(lambda pair: value, name)
    found = {}
    for number, label in enumerate([CLEAN, *labels]):
        dataset: dict[str, Any] = {"fingerprint": f"{number:064x}"}
        own = dict(method)
        if label != CLEAN:
            dataset |= {"name": f"demo-1@{label}", "short": f"demo@{label}", "degradation": label}
            dataset["recipe"] = {"name": "", "parameters": {}}
        elif own.get("fitted_on"):
            own["fitted_on"] = None
        texts = {k: v.format(label=label) for k, v in own.items() if isinstance(v, str)}
        result = clean if label == CLEAN else tracked
        found[label] = edited(result, dataset=dataset, method=own | texts)
    return found
