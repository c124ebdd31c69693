"""The verb that asks whether a test is fair: coverage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer
from matplotlib.figure import Figure

from dfdbench.audit.coverage import (
    CoverageRecord,
    Criterion,
    DensityBound,
    compare_depths,
    coverage_table,
    each_as_json,
    each_table,
    verdict_line,
)
from dfdbench.audit.leaks import Leak, LeakError, find_leaks, leaks_between, scene_hashes
from dfdbench.audit.run_errors import (
    conclusion,
    error_table,
    errors_as_json,
    join_errors,
    scene_table,
)
from dfdbench.audit.sides import Side, all_but, scene_histograms, side_of, sides_of
from dfdbench.audit.trained_on import RunSides, sides_of_run
from dfdbench.cli.options import Out, data_sets
from dfdbench.cli.screen import Answer, Answered, AnswerFormat, give
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.errors import InputError, Problem
from dfdbench.figures.audits import coverage_figure, level_error_figure, mask_figure
from dfdbench.results.output_place import output_place
from dfdbench.results.record import Result
from dfdbench.results.record_file import RESULT, load_result


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
        str | None,
        typer.Argument(
            help="The training data set: its name or a store's path.", autocompletion=data_sets
        ),
    ] = None,
    train: Annotated[
        str | None, typer.Option(help="The split to train on; default: train.")
    ] = None,
    test: Annotated[
        str | None,
        typer.Option(
            help="The split to test on; default: test, or with --test-dataset all its pairs."
        ),
    ] = None,
    fold: Annotated[
        str | None, typer.Option(help="Test on this fold or scene, train on all other scenes.")
    ] = None,
    test_dataset: Annotated[
        str | None, typer.Option(help="Test on another data set: its name or a store's path.")
    ] = None,
    each: Annotated[
        Each | None, typer.Option(help="Test every scene or fold against all other scenes.")
    ] = None,
    result: Annotated[
        Path | None,
        typer.Option(
            help="A run's result.json: also show its errors on covered and uncovered depths."
        ),
    ] = None,
    criterion: CriterionOption = Criterion.either,
    allow: AllowOption = 0.0,
    density_factor: FactorOption = DensityBound.factor,
    density_floor: FloorOption = DensityBound.floor,
    out: Out = None,
    format: Answered = AnswerFormat.table,
) -> None:
    """Ask whether training covers the depths of the test; status 1 where it does not."""
    rule = Rule(DensityBound(density_factor, density_floor), criterion, allow)
    if result and result.is_dir():
        result = result / RESULT
    run = load_result(result) if result else None
    named = {"--train": train, "--test": test, "--fold": fold, "--test-dataset": test_dataset}
    _refuse_mixtures(dataset, run, each, [option for option, name in named.items() if name])
    store = open_dataset(dataset or (run.dataset.name if run else ""))
    if each:
        _answer_each(store, each, rule, out, format)
    elif run and result:
        saw = run.method.trained_on or run.method.fitted_on
        sides = sides_of_run(store, run.dataset.split, saw, train, fold)
        _answer_errors(store, run, result.parent, sides, rule, out, format)
    else:
        other = open_dataset(test_dataset) if test_dataset else None
        both = sides_of(store, train, test, fold, other)
        record = rule.compare(*both, leaks_between(*both))
        _answer_coverage(record, _place(out, _folder(store, record)), format)


@dataclass(frozen=True)
class Rule:
    """By which a test counts as covered."""

    bound: DensityBound
    criterion: Criterion
    allowed_share: float

    def compare(self, train: Side, test: Side, leaks: Sequence[Leak]) -> CoverageRecord:
        """Hold a test side against a training side."""
        return compare_depths(
            train, test, self.bound, self.criterion, self.allowed_share, tuple(leaks)
        )


def _end(*records: CoverageRecord) -> None:
    leaks = [leak for record in records for leak in record.leaks]
    if leaks:
        raise LeakError.of(leak.as_problem() for leak in leaks)
    if not all(record.covered for record in records):
        raise typer.Exit(1)


def _refuse_mixtures(
    dataset: str | None, run: Result | None, each: Each | None, named: list[str]
) -> None:
    problems = []
    if dataset is None and run is None:
        problems.append(Problem("no data set is named", fix="dfdbench audit coverage DATASET"))
    others = [*named, *(["--result"] if run else [])]
    if each and others:
        problems.append(
            Problem(
                "--each takes no split and no result",
                where="--each",
                fix=f"leave out {_list(others)}",
            )
        )
    elif run and (tests := [name for name in named if name in ("--test", "--test-dataset")]):
        problems.append(
            Problem(
                "a result says itself what tests", where="--result", fix=f"leave out {_list(tests)}"
            )
        )
    if run and {"--train", "--fold"} <= set(named):
        problems.append(Problem("a fold says what trains", where="--fold", fix="leave out --train"))
    if problems:
        raise InputError.of(problems)


def _list(options: list[str]) -> str:
    return " and ".join(options)


def _answer_coverage(record: CoverageRecord, folder: Path, format: AnswerFormat) -> None:
    content = record.model_dump_json(indent=1) + "\n"
    answer = Answer(content, (coverage_table(record),), verdict_line(record))
    give(
        answer, format, folder, {"coverage.json": content, "coverage.png": coverage_figure(record)}
    )
    _end(record)


def _answer_each(
    store: Dataset, each: Each, rule: Rule, out: str | None, format: AnswerFormat
) -> None:
    manifest, histograms = store.manifest, scene_histograms(store)
    folds = {fold.name: tuple(fold.test_scenes) for fold in manifest.folds}
    tests = folds if each is Each.fold else {name: (name,) for name in histograms}
    if not tests:
        raise InputError(f"{manifest.stem} has no folds", where="--each", fix="--each scene")
    hashes = scene_hashes(store, histograms)
    records = {}
    for name, scenes in tests.items():
        if any(scene in histograms for scene in scenes):
            train, test = all_but(store, histograms, name), side_of(store, histograms, name, scenes)
            of_train, of_test = ({s: hashes[s] for s in side.scenes} for side in (train, test))
            leaks = find_leaks(manifest, of_train, manifest, of_test)
            records[name] = rule.compare(train, test, leaks)
    bad = sum(not record.covered for record in records.values())
    verdict = f"{bad} of {len(records)} are NOT covered by criterion {rule.criterion}"
    content = each_as_json(records, each)
    folder = _place(out, Path("results") / f"{store.path.stem}-coverage" / f"each-{each}")
    answer = Answer(content, (each_table(records, each),), verdict)
    give(answer, format, folder, {"coverage.json": content})
    _end(*records.values())


def _answer_errors(
    store: Dataset,
    run: Result,
    folder: Path,
    sides: RunSides,
    rule: Rule,
    out: str | None,
    format: AnswerFormat,
) -> None:
    record = rule.compare(sides.train, sides.test, leaks_between(sides.train, sides.test))
    join = join_errors(store, run, folder, record)
    title = (
        f"errors of {run.method.title} on {run.dataset.label}, {run.dataset.split}, by what "
        f"{record.train.label}, {record.train.split}, covers"
    )
    meaning = conclusion(join, record, sides.training)
    content = errors_as_json(join, run, record, sides.training)
    answer = Answer(content, (error_table(join, title, meaning), scene_table(join)))
    files: dict[str, str | Figure] = {
        "errors.json": content,
        "coverage.json": record.model_dump_json(indent=1) + "\n",
        "coverage.png": coverage_figure(record),
        "errors.png": level_error_figure(join, title),
        "masks.png": mask_figure(store, run, folder, join),
    }
    # By default beside the result: the one folder in a run that others may write to.
    place = folder / "coverage" if out is None else output_place(out)
    give(answer, format, place, files)
    _end(record)


def _place(out: str | None, default: Path) -> Path:
    return output_place(default if out is None else out)


def _folder(store: Dataset, record: CoverageRecord) -> Path:
    test = record.test
    name = test.split if test.dataset == record.train.dataset else f"{test.dataset}-{test.split}"
    if not record.train.split.startswith("all but"):
        name = f"{record.train.split}-{name}"
    return Path("results") / f"{store.path.stem}-coverage" / name
