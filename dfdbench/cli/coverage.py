"""The verb that asks whether a test is fair: coverage."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from dfdbench.cli.answer import AnswerFormat, keep, show
from dfdbench.coverage import Criterion, DensityBound
from dfdbench.coverage_errors import error_table, errors_as_json, join_errors, scene_table
from dfdbench.coverage_figures import coverage_figure, level_error_figure, mask_figure
from dfdbench.coverage_record import CoverageRecord, compare
from dfdbench.coverage_report import coverage_table, each_as_json, each_table, verdict_line
from dfdbench.depths import Side, scene_histograms, side_of, sides_of, training_of
from dfdbench.errors import InputError, Problem
from dfdbench.leaks import Leak, LeakError, find_leaks, scene_hashes
from dfdbench.result import Result, load_result
from dfdbench.store import Store, open_store
from dfdbench.trained_on import training_side


class Each(StrEnum):
    """What is tested one by one against all other scenes."""

    scene = "scene"
    fold = "fold"


CriterionOption = Annotated[
    Criterion, typer.Option(help="What makes a level uncovered; either: both are applied.")
]
AllowOption = Annotated[
    float, typer.Option(min=0, max=1, help="Share of the test that may lie on uncovered levels.")
]
FactorOption = Annotated[
    float, typer.Option(min=1, help="Density: how many times the share in training is too much.")
]
FloorOption = Annotated[
    float, typer.Option(min=0, max=1, help="Density: a smaller share of the test is no alarm.")
]


def coverage(
    dataset: Annotated[
        str | None, typer.Argument(help="A data set's name or a store's path: what trains.")
    ] = None,
    train: Annotated[
        str | None, typer.Option(help="The split that trains; default: train.")
    ] = None,
    test: Annotated[
        str | None, typer.Option(help="The split that tests; default: test, of others all.")
    ] = None,
    fold: Annotated[
        str | None, typer.Option(help="A fold or a scene that tests; all other scenes train.")
    ] = None,
    test_dataset: Annotated[
        str | None, typer.Option(help="Another data set, or its store, that tests.")
    ] = None,
    each: Annotated[
        Each | None, typer.Option(help="Test every scene or fold against all other scenes.")
    ] = None,
    result: Annotated[
        Path | None, typer.Option(help="A run's result.json: its errors by coverage.")
    ] = None,
    criterion: CriterionOption = Criterion.either,
    allow: AllowOption = 0.0,
    density_factor: FactorOption = DensityBound.factor,
    density_floor: FloorOption = DensityBound.floor,
    out: Annotated[
        Path | None, typer.Option(help="Folder; default: results/DATASET-coverage/TEST.")
    ] = None,
    format: Annotated[
        AnswerFormat, typer.Option(help="How the answer is printed.")
    ] = AnswerFormat.table,
) -> None:
    """Ask whether training covers the depths of the test; status 1 where it does not."""
    rule = Rule(DensityBound(density_factor, density_floor), criterion, allow)
    run = load_result(result) if result else None
    _refuse_mixtures(dataset, run, each, (train, test, fold, test_dataset))
    store = open_store(dataset or (run.dataset.short if run else ""))
    if each:
        _show_each(store, each, rule, out, format)
    elif run and result:
        sides = _sides_of_run(store, run, train, fold)
        _show_errors(store, run, result, rule.compare(*sides), out, format)
    else:
        other = open_store(test_dataset) if test_dataset else None
        sides = sides_of(store, train, test, fold, other)
        _show_coverage(store, other or store, sides, rule, out, format)


@dataclass(frozen=True)
class Rule:
    """By which a test counts as covered."""

    bound: DensityBound
    criterion: Criterion
    allowed_share: float

    def compare(self, train: Side, test: Side, leaks: tuple[Leak, ...] = ()) -> CoverageRecord:
        """Hold a test side against a training side."""
        return compare(train, test, self.bound, self.criterion, self.allowed_share, leaks)


def _show_coverage(
    store: Store,
    tester: Store,
    sides: tuple[Side, Side],
    rule: Rule,
    out: Path | None,
    format: AnswerFormat,
) -> None:
    train, test = sides
    leaks = find_leaks(
        store.manifest, scene_hashes(store, train.scenes),
        tester.manifest, scene_hashes(tester, test.scenes),
    )  # fmt: skip
    record = rule.compare(train, test, tuple(leaks))
    content = record.model_dump_json(indent=1) + "\n"
    if format is AnswerFormat.json:
        print(content, end="")
    else:
        show(coverage_table(record), format)
        print(verdict_line(record))
    keep(
        out or _folder(store, record),
        {"coverage.json": content, "coverage.png": coverage_figure(record)},
    )
    if leaks:
        raise LeakError(leak.as_problem() for leak in leaks)
    _end(record)


def _end(*records: CoverageRecord) -> None:
    if not all(record.covered for record in records):
        raise typer.Exit(1)


def _refuse_mixtures(
    dataset: str | None, run: Result | None, each: Each | None, splits: tuple[str | None, ...]
) -> None:
    train, test, fold, test_dataset = splits
    problems = []
    if dataset is None and run is None:
        problems.append(Problem("no data set is named", fix="dfdbench coverage DATASET"))
    if each and (run or any(splits)):
        problems.append(Problem("--each takes no split and no result", "--each"))
    if run and (test or test_dataset):
        problems.append(
            Problem("a result says itself what tests", "--result", fix="leave out --test")
        )
    if run and train and fold:
        problems.append(Problem("a fold says what trains", "--fold", fix="leave out --train"))
    if problems:
        raise InputError(problems)


def _sides_of_run(
    store: Store, run: Result, train: str | None, fold: str | None
) -> tuple[Side, Side]:
    manifest, split = store.manifest, run.dataset.split
    histograms = scene_histograms(store)
    test = side_of(store, histograms, split, manifest.scenes_of(split))
    said = run.method.trained_on
    if not (train or fold) and said and (named := training_side(said, store)):
        return named, test
    folds = {item.name for item in manifest.folds}
    left_out = fold or (split if split in folds and not train else None)
    if left_out:
        scenes = training_of(manifest, left_out)
        return side_of(store, histograms, f"all but {left_out}", scenes), test
    name = train or "train"
    return side_of(store, histograms, name, manifest.scenes_of(name)), test


def _show_each(
    store: Store, each: Each, rule: Rule, out: Path | None, format: AnswerFormat
) -> None:
    manifest, histograms = store.manifest, scene_histograms(store)
    folds = {fold.name: tuple(fold.test_scenes) for fold in manifest.folds}
    tests = folds if each is Each.fold else {name: (name,) for name in histograms}
    records = {
        name: rule.compare(
            side_of(store, histograms, f"all but {name}", training_of(manifest, name)),
            side_of(store, histograms, name, scenes),
        )
        for name, scenes in tests.items()
        if any(scene in histograms for scene in scenes)
    }
    if not records:
        raise InputError(Problem(f"{manifest.stem} has no {each}", "--each"))
    content = each_as_json(records, each)
    if format is AnswerFormat.json:
        print(content, end="")
    else:
        show(each_table(records, each), format)
        bad = sum(not record.covered for record in records.values())
        print(f"{bad} of {len(records)} are NOT covered by criterion {rule.criterion}")
    folder = out or Path("results") / f"{store.path.stem}-coverage" / f"each-{each}"
    keep(folder, {"coverage.json": content})
    _end(*records.values())


def _show_errors(
    store: Store,
    run: Result,
    path: Path,
    record: CoverageRecord,
    out: Path | None,
    format: AnswerFormat,
) -> None:
    join = join_errors(store, run, path.parent, record)
    title = (
        f"errors of {run.method.name} on {run.dataset.name}, {run.dataset.split}, by what "
        f"{record.train.dataset}, {record.train.split}, covers"
    )
    content = errors_as_json(join, run, record)
    if format is AnswerFormat.json:
        print(content, end="")
    else:
        show(error_table(join, title, run.method.trained_on is not None), format)
        show(scene_table(join), format)
    keep(
        out or path.parent / "coverage",
        {
            "errors.json": content,
            "coverage.json": record.model_dump_json(indent=1) + "\n",
            "coverage.png": coverage_figure(record),
            "errors.png": level_error_figure(join, title),
            "masks.png": mask_figure(store, run, path.parent, join),
        },
    )
    _end(record)


def _folder(store: Store, record: CoverageRecord) -> Path:
    test = record.test
    name = test.split if test.dataset == record.train.dataset else f"{test.dataset}-{test.split}"
    if not record.train.split.startswith("all but"):
        name = f"{record.train.split}-{name}"
    return Path("results") / f"{store.path.stem}-coverage" / name
