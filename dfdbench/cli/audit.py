"""The verbs of `audit`: coverage, depths, split, difficulty."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

from typer import Argument, Exit, Option

from dfdbench.audit import coverage as cover
from dfdbench.audit import difficulty as hardness
from dfdbench.audit import leaks, run_errors, sides, splits, trained_on
from dfdbench.board.row_file import read_row
from dfdbench.cli import screen
from dfdbench.cli.options import Cache, DataSetArgument, Out, Printed, Split, data_sets
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.manifest import ALL_PAIRS, Pair
from dfdbench.errors import InputError, StoreError, refuse_alone, refuse_both
from dfdbench.figures import audits
from dfdbench.results.output_place import output_place
from dfdbench.results.record import RESULT, Result, load_result
from dfdbench.results.wording import method_label
from dfdbench.statuses import NO
from dfdbench.tables.table import Format, Table, counted

_CONSTANT = "constant"
#: Parts of which each is tested against all others.
Each = Literal["scene", "fold"]
CriterionOption = Annotated[
    cover.Criterion, Option(help="What makes a level uncovered; either: both are applied.")
]
AllowOption = Annotated[
    float, Option(min=0, max=1, help="Share of the test that may lie on uncovered levels.")
]
FactorOption = Annotated[
    float, Option(min=1, help="Density: how many times the share in training is too much.")
]
FloorOption = Annotated[
    float, Option(min=0, max=1, help="Density: a smaller share of the test is no alarm.")
]


def depths(
    dataset: DataSetArgument,
    split: Annotated[
        str | None, Option(help="A split, a fold, a scene, or all, which is the default.")
    ] = None,
    result: Annotated[
        list[Path] | None, Option(help="A run's folder, for its errors by depth; repeatable.")
    ] = None,
    figure: Annotated[
        Path | None, Option(metavar="FILE.png", help="Draw the histogram, or errors, there.")
    ] = None,
    format: Printed = Format.table,
    cache: Cache = None,
) -> None:
    """Count how often each depth occurs, or with --result how far runs are off at each depth."""
    refuse_both({"--result": result}, {"--split": split})
    store = open_dataset(dataset, cache=cache)
    if result:
        tables = _errors(store, result, figure)
    else:
        side = sides.side_of(store, split or ALL_PAIRS)
        if figure is not None:
            screen.save_figure(audits.depths_figure(side), figure)
        tables = [run_errors.level_count_table(side)]
    screen.show(format, tables)


def _errors(store: Dataset, places: list[Path], figure: Path | None) -> list[Table]:
    results = [load_result(place) for place in places]
    runs = [
        (method_label(result.method), _folder_of(place), result)
        for place, result in zip(places, results, strict=True)
    ]
    found = [
        run_errors.depth_errors(store, result, folder, name)
        for name, folder, result in _told_apart(runs)
    ]
    first = results[0]
    if all(label != _CONSTANT for label, *_ in runs):
        found += _constant(store, first)
    tables = run_errors.depth_error_tables(store, first.dataset.split, found)
    if figure is not None:
        title = f"{store.manifest.label}, split {first.dataset.split}: errors by depth"
        screen.save_figure(
            audits.depth_error_figure(title, found, store.manifest.depth.scale), figure
        )
    return tables


def _told_apart(runs: Sequence[tuple[str, Path, Result]]) -> Iterator[tuple[str, Path, Result]]:
    """Yield runs by name; where names are equal, add the folders'."""
    labels = [label for label, *_ in runs]
    for label, folder, result in runs:
        yield f"{label}, {folder}" if labels.count(label) > 1 else label, folder, result


def _folder_of(result: Path) -> Path:
    return result.parent if result.is_file() else result


def _constant(store: Dataset, result: Result) -> list[run_errors.DepthErrors]:
    from dfdbench.evaluation.loading import training_mean

    try:
        level = training_mean(store, result.dataset.split)
    except StoreError:  # without training captures there is no constant to compare with
        return []
    return [run_errors.constant_errors(store, result, level, _CONSTANT)]


def difficulty(
    dataset: DataSetArgument,
    split: Split = "test",
    noise: Annotated[
        int, Option(min=0, max=255, help="Whole grey levels that a change must exceed.")
    ] = 0,
    bound: Annotated[
        bool, Option("--bound", help="Show instead the least error under the fitted blur.")
    ] = False,
    result: Annotated[
        list[Path] | None,
        Option(help="With --bound: a run's folder, or a board's with rows; repeatable."),
    ] = None,
    out: Out = None,
    format: Printed = Format.table,
) -> None:
    """Say for which pixels the blur cannot tell neighbouring depth levels apart."""
    refuse_alone({"--result": result}, {"--bound": bound})
    store = open_dataset(dataset)
    manifest, folder = store.manifest, _place(out, store, "bound" if bound else "difficulty", split)
    if bound:
        _answer_bound(store, split, result or [], folder, format)
        return
    with screen.progress("looking at pairs", "nothing was written") as step:
        found = hardness.split_difficulty(store, split, noise, step)
    rows = hardness.difficulty_rows(manifest, found)
    chosen = _ends_and_middle(found, lambda pair: found[pair].share_above(hardness.COARSE))
    figure = audits.difficulty_figure(
        f"easiest, median and hardest pair of {manifest.label}, {split}",
        [(pair.id, store.read(pair).infocus, found[pair]) for pair in chosen],
    )
    content = hardness.difficulty_as_json(manifest, store.fingerprint, noise, rows)
    table = hardness.difficulty_table(manifest, split, rows, noise)
    screen.give([table], format, folder, {"difficulty.json": content, "difficulty.png": figure})


def _answer_bound(
    store: Dataset, split: str, places: list[Path], folder: Path, format: Format
) -> None:
    from dfdbench.evaluation.fitting import training_pairs

    manifest = store.manifest
    manifest.scenes_of(split)
    runs = _runs_on(store, split, places)
    training = training_pairs(store, split, manifest.pair_images)[1]
    with screen.progress("looking at pairs", "nothing was written") as step:
        law, found = hardness.split_bounds(store, split, training, step)
    figure = audits.bound_figure(
        f"least error in {manifest.label}, {split}: best, median and worst pair",
        [
            (pair.id, store.read(pair).shown[0], found[pair])
            for pair in _ends_and_middle(found, lambda pair: found[pair].nrmse[hardness.DRAWN])
        ],
    )
    content = hardness.bound_as_json(manifest, store.fingerprint, law, found)
    table = hardness.bound_table(manifest, split, found, runs)
    screen.give([table], format, folder, {"bound.json": content, "bound.png": figure})


def _runs_on(store: Dataset, split: str, places: list[Path]) -> dict[str, Result]:
    """Return results on a split of this store by name: of runs, or of a board's rows."""
    runs: list[tuple[str, Path, Result]] = []
    for place in places:
        if place.is_file() or (place / RESULT).is_file():
            result = load_result(place)
            named = [(method_label(result.method), result)]
        else:
            rows = {path.stem: read_row(path) for path in sorted(place.glob("*.json"))}
            named = [(name, result) for name, row in rows.items() for result in row.results]
        own = [
            (name, _folder_of(place), result)
            for name, result in named
            if (result.dataset.fingerprint, result.dataset.split) == (store.fingerprint, split)
        ]
        if not own:
            what = f"no run of split {split} of this {store.manifest.stem}"
            fix = "name a run's own folder, or a folder of a board's rows"
            raise InputError(what, where=str(place), fix=fix)
        runs += own
    return {name: result for name, _, result in _told_apart(runs)}


def _ends_and_middle(pairs: Iterable[Pair], size: Callable[[Pair], float]) -> list[Pair]:
    order = sorted(pairs, key=size)
    return list(dict.fromkeys((order[0], order[len(order) // 2], order[-1])))


def split_command(
    dataset: DataSetArgument,
    test_scenes: Annotated[
        int | None, Option(min=1, help="Propose test splits of this many scenes.")
    ] = None,
    folds: Annotated[int | None, Option(min=2, help="Propose this many folds instead.")] = None,
    criterion: CriterionOption = cover.Criterion.either,
    allow: AllowOption = 0.0,
    density_factor: FactorOption = cover.Rule.density_factor,
    density_floor: FloorOption = cover.Rule.density_floor,
    seed: Annotated[
        int, Option(min=0, help="Seed of what is drawn: folds, and splits if too many.")
    ] = 0,
    out: Out = None,
    format: Printed = Format.table,
) -> None:
    """Propose splits or folds by scene whose training covers their tests' depths."""
    store = open_dataset(dataset)
    rule = cover.Rule(criterion, allow, density_factor, density_floor)
    found = splits.propose(store, test_scenes, folds, rule, seed)
    screen.give([found.table], format, _place(out, store, "splits", found.name), found.files)


def coverage(
    dataset: Annotated[
        str | None, Argument(help="The data set that trains.", autocompletion=data_sets)
    ] = None,
    train: Annotated[str | None, Option(help="The split to train on; default: train.")] = None,
    test: Annotated[
        str | None, Option(help="Tests; default: test, or all with --test-dataset.")
    ] = None,
    fold: Annotated[
        str | None, Option(help="Test on this fold or scene, train on the others.")
    ] = None,
    test_dataset: Annotated[
        str | None, Option(help="Test on another data set: its name or a store's path.")
    ] = None,
    each: Annotated[
        Each | None, Option(help="Test every scene or fold against the others.")
    ] = None,
    result: Annotated[
        Path | None, Option(help="A run's folder: show its errors by coverage, too.")
    ] = None,
    criterion: CriterionOption = cover.Criterion.either,
    allow: AllowOption = 0.0,
    density_factor: FactorOption = cover.Rule.density_factor,
    density_floor: FloorOption = cover.Rule.density_floor,
    out: Out = None,
    format: Printed = Format.table,
) -> None:
    """Ask whether training covers the depths of the test; status 1 if it does not."""
    rule = cover.Rule(criterion, allow, density_factor, density_floor)
    run = load_result(result) if result else None
    if not dataset and not result:
        raise InputError("no data set is named", fix="dfdbench audit coverage DATASET")
    trains, tests = {"--train": train}, {"--test": test, "--test-dataset": test_dataset}
    refuse_both({"--fold": fold}, trains | tests)
    refuse_both({"--each": each}, {"--fold": fold, **trains, **tests, "--result": result})
    refuse_both({"--result": result}, tests)
    store = open_dataset(dataset or (run.dataset.name if run else ""))
    if each:
        _answer_each(store, each, rule, out, format)
    elif run and result:
        saw = run.method.trained_on or run.method.fitted_on
        side, tested, known = trained_on.sides_of_run(store, run.dataset.split, saw, train, fold)
        record = cover.compare_depths(side, tested, rule, leaks.leaks_between(side, tested))
        _answer_errors(store, run, _folder_of(result), known, record, out, format)
    else:
        other = open_dataset(test_dataset) if test_dataset else None
        both = sides.sides_of(store, train, test, fold, other)
        record = cover.compare_depths(*both, rule, leaks.leaks_between(*both))
        figure = audits.coverage_figure(record)
        place = _place(out, store, "coverage", _compared(record))
        files: screen.Files = {"coverage.json": cover.as_json(record), "coverage.png": figure}
        screen.give(
            [cover.coverage_table(record)], format, place, files, cover.verdict_line(record)
        )
        _end(record)


def _end(*records: cover.CoverageRecord) -> None:
    found = [leak for record in records for leak in record.leaks]
    leaks.LeakError.raise_if(leak.as_problem() for leak in found)
    if not all(record.covered for record in records):
        raise Exit(NO)


def _answer_each(
    store: Dataset, each: Each, rule: cover.Rule, out: str | None, format: Format
) -> None:
    manifest, histograms = store.manifest, sides.scene_histograms(store)
    folds = {fold.name: tuple(fold.test_scenes) for fold in manifest.folds}
    tests = folds if each == "fold" else {name: (name,) for name in histograms}
    if not tests:
        raise InputError(f"{manifest.stem} has no folds", where="--each", fix="--each scene")
    records = {}
    for name, scenes in tests.items():
        if any(scene in histograms for scene in scenes):
            train, test = sides.all_but(store, name), sides.side_of(store, name, scenes)
            shared = leaks.leaks_between(train, test)
            records[name] = cover.compare_depths(train, test, rule, shared)
    bad = sum(not record.covered for record in records.values())
    verdict = f"{bad} of {len(records)} are NOT covered by criterion {rule.criterion}"
    files = {"coverage.json": cover.each_as_json(records, each)}
    place = _place(out, store, "coverage", f"each-{each}")
    screen.give([cover.each_table(records, each)], format, place, files, verdict)
    _end(*records.values())


def _answer_errors(
    store: Dataset,
    run: Result,
    folder: Path,
    training: trained_on.Training,
    record: cover.CoverageRecord,
    out: str | None,
    format: Format,
) -> None:
    join = run_errors.join_errors(store, run, folder, record)
    data = run.dataset
    some = "" if run.complete else f"only {data.evaluated} of {counted(data.expected, 'pair')}, "
    title = (
        f"errors of {run.method.title} on {data.label}, {data.split}, {some}by what "
        f"{record.train.label}, {record.train.split}, covers"
    )
    tables = [
        run_errors.error_table(join, title, run_errors.conclusion(join, record, training)),
        run_errors.scene_table(join),
    ]
    files: screen.Files = {
        "errors.json": run_errors.errors_as_json(join, run, record, training),
        "coverage.json": cover.as_json(record),
        "coverage.png": audits.coverage_figure(record),
        "errors.png": audits.level_error_figure(join, title),
        "masks.png": audits.mask_figure(store, run, folder, join),
    }
    # By default beside the result: the one folder in a run that others may write to.
    place = folder / "coverage" if out is None else output_place(out)
    screen.give(tables, format, place, files)
    _end(record)


def _place(out: str | None, store: Dataset, what: str, name: str) -> Path:
    default = Path("results", f"{store.path.stem}-{what}", name)
    return output_place(default if out is None else out)


def _compared(record: cover.CoverageRecord) -> str:
    test = record.test
    name = test.split if test.dataset == record.train.dataset else f"{test.dataset}-{test.split}"
    return name if record.train.split.startswith("all but") else f"{record.train.split}-{name}"
