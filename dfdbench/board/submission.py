"""Put a method's runs on the leaderboard: write its row, or update it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dfdbench.blur.tracks import CLEAN, SUITES
from dfdbench.board import LEADERBOARD, board, cards, row_file
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.fingerprint import require_sound
from dfdbench.errors import InputError, Problem, ResultError
from dfdbench.methods.method import Method
from dfdbench.methods.registry import built_in_methods
from dfdbench.results.record import Result
from dfdbench.results.wording import without_folder, without_folders
from dfdbench.system.files import write_whole


def require_submittable(limit: int | None) -> None:
    """Refuse, before a run, one that the leaderboard would refuse, or a place without one.

    Raises
    ------
    InputError, ResultError
        If the run is limited to some pairs, or there is no leaderboard here.
    """
    if limit:
        fix = "leave out --limit; pairs that were run already are taken over"
        raise InputError("a limited run cannot be submitted", where=f"--limit {limit}", fix=fix)
    if not LEADERBOARD.is_dir():
        fix = "run this in the root of a clone of dfdbench"
        raise ResultError("no leaderboard here to submit to", where=str(LEADERBOARD), fix=fix)
    board.require_leaderboard(LEADERBOARD)


def require_fit_to_submit(method: Method, store: Dataset, split: str) -> None:
    """Refuse a damaged data set, a method without a card, and one that has seen the test.

    Raises
    ------
    StoreError, ResultError, InputError
        If the data set does not hold what was built; if the method has no card; if its weights
        were trained on scenes of the test.
    """
    parameters = without_folders(method.parameters)
    cards.find_card(LEADERBOARD, method.name, without_folder(method.entry), parameters)
    require_sound(store)
    saw, where = (method.trained_on, method.weights_sha256), f"--split {split}"
    InputError.raise_if(row_file.training_problems(*saw, store.manifest.stem, split, where))


def submit(results: Result | Sequence[Result], folder: Path) -> Path:
    """Write runs into the row of their method's card, and return its file.

    Runs that the row has on other tracks stay, provided that they are of the same method.

    Parameters
    ----------
    results : Result or sequence of Result
        Runs of one method on one split, on clean images, on tracks, or both.
    folder : Path
        The leaderboard's folder.

    Raises
    ------
    ResultError
        If a run is not on a released data set's split, the runs are not of one method, the method
        has no card, another method's row is there, or a complete run would give way to a partial
        one. Nothing is written then.
    """
    runs = [results] if isinstance(results, Result) else list(results)
    labels = {run.dataset.degradation for run in runs}
    _require_one_method(runs)
    row = row_file.row_of(runs, [CLEAN])
    row_file.require_pairs(row, "this run")
    ResultError.raise_if(row_file.row_problems(row, folder, "this run"))
    method = row.method
    name = cards.find_card(folder, method.name, method.entry, method.parameters, row.given_blur)
    path = row.place(folder, name)
    suites: list[str] = []
    if path.exists():
        there = row_file.read_row(path)
        _require_same_method(there.results[0], runs[0], path)
        _require_no_less(there.results, runs, path)
        runs += [run for run in there.results if run.dataset.degradation not in labels]
        suites = there.suites
    # Clean images that were run along with tracks do not enter the ranking of clean images.
    clean = labels == {CLEAN}
    entered = [CLEAN] if clean else _suites({r.dataset.degradation for r in runs})
    order = [CLEAN, *SUITES]
    row = row_file.row_of(runs, sorted({*suites, *entered}, key=order.index))
    write_whole(path, row_file.row_text(row))
    return path


def _suites(labels: set[str]) -> list[str]:
    whole = [name for name, suite in SUITES.items() if labels.issuperset(suite)]
    begun = [name for name, suite in SUITES.items() if (labels - {CLEAN}).issubset(suite)]
    return whole or begun[:1] or [next(iter(SUITES))]


def _facts(result: Result) -> dict[str, Any]:
    """Return what makes two runs those of one method on one split."""
    method, dataset = result.method, result.dataset
    facts = {
        "name": method.name,
        "parameters": method.parameters,
        "split": dataset.split,
        "manifest_sha256": dataset.manifest_sha256,
        "entry": method.entry,
        "weights_sha256": method.weights_sha256,
        "files_sha256": method.files_sha256,
        "seed": result.seed,
    }
    # Ours may change in ways that do not matter.
    if method.entry not in built_in_methods().values():
        facts["source_sha256"] = method.source_sha256
    return facts


def _differing(one: Result, other: Result) -> list[tuple[str, Any, Any]]:
    found, own = _facts(one), _facts(other)
    return [(name, found.get(name), own[name]) for name in own if found.get(name) != own[name]]


def _require_one_method(runs: Sequence[Result]) -> None:
    what = "the runs are not of one method on one split"
    ResultError.raise_if(
        Problem(f"{what}: {value}, not {first}", where=f"{run.dataset.degradation}: {name}")
        for run in runs
        for name, first, value in _differing(runs[0], run)
    )


def _require_same_method(there: Result, new: Result, path: Path) -> None:
    if differing := _differing(there, new):
        name, found, own = differing[0]
        what = f"another method is there: its {name} is {found}, not {own}"
        fix = "give your method a card of another name; if the row is yours, remove its file"
        raise ResultError(what, where=str(path), fix=fix)


def _require_no_less(there: Sequence[Result], new: Sequence[Result], path: Path) -> None:
    whole = {run.dataset.degradation for run in there if run.complete}
    for run in new:
        if run.dataset.degradation in whole and not run.complete:
            data, fix = run.dataset, "run the rest: the same command continues where it stopped"
            done = f"{data.degradation}, {data.evaluated} of {data.expected} pairs"
            what = f"a partial run on {done}, would replace a complete one"
            raise ResultError(what, where=str(path), fix=fix)
