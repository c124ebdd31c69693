"""The verbs that repeat the thesis's experiments: experiment, reduce."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dfdbench.building.build import build_store
from dfdbench.building.voltage_pairs import voltage_pair_sets
from dfdbench.cli.options import Cache, DataSet, Out, Printed, Seed, pool_of, value_of, values_of
from dfdbench.cli.screen import print_tables, progress, save_figure, say, writing
from dfdbench.cli.training import (
    Changes,
    Configuration,
    Device,
    MaxTime,
    Network,
    Threads,
    Weights,
    seconds_of,
    stepping,
    use_threads,
)
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError
from dfdbench.results.output_place import output_place
from dfdbench.system.files import write_whole
from dfdbench.system.packages import needed
from dfdbench.tables.render import render
from dfdbench.tables.table import Format, Table, counted

if TYPE_CHECKING:
    from dfdbench.methods.networks.weights import Card
    from dfdbench.training.experiments import Experiment, Trial


_REDUCTION = "reduction"
_PUBLISHED = "published"


def experiment(
    name: Annotated[
        str,
        typer.Argument(
            help="repeatability, cross-validation, patch-size, noise, sampling-size, expansion, "
            "reduction, sharpest-step or voltage-pairs."
        ),
    ],
    method: Annotated[Network, typer.Option(help="The network to train.")] = Network.dfd_net,
    dataset: Annotated[
        str | None,
        typer.Option(
            help="A data set's name or a store's path; default: middlebury, for voltage steps "
            "realworld."
        ),
    ] = None,
    source: Annotated[
        Path | None, typer.Option(help="Folder of the captures, where the voltage steps vary.")
    ] = None,
    rows: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="For the experiment reduction: a folder of networks that `dfdbench thesis reduce` "
            "wrote, instead of those of the thesis's Table D.2.",
        ),
    ] = None,
    config: Configuration = _PUBLISHED,
    changes: Changes = None,
    weights: Weights = None,
    values: Annotated[
        str | None, typer.Option(metavar="A,B,...", help="Values to try instead of the thesis's.")
    ] = None,
    repeats: Annotated[
        int | None,
        typer.Option(
            min=1, help="How often to train with each value; default: as often as the thesis."
        ),
    ] = None,
    max_time: MaxTime = None,
    out: Out = None,
    format: Printed = Format.table,
    device: Device = "auto",
    threads: Threads = None,
    cache: Cache = None,
) -> None:
    """Train for each value and seed of an experiment of the thesis; a stopped one is resumed."""
    limit = seconds_of(max_time)
    with needed():
        from dfdbench.figures.trainings import experiment_figure
        from dfdbench.methods.networks.weights import find_weights
        from dfdbench.training.experiments import find_experiment, trials
    use_threads(threads)
    asked, chosen = find_experiment(name), _listed(values)
    configs = _rows_of(name, rows, chosen, config)
    store, stem = _data_of(asked, name, dataset, chosen, source, cache)
    default = Path("training") / f"{stem}-experiments" / f"{name}-{method.value}"
    folder = output_place(out or default, source, rows)
    start = find_weights(method.value, weights) if weights else None
    planned = trials(
        asked,
        method.value,
        store,
        configs or config,
        values_of(changes, "--set"),
        folder,
        chosen,
        repeats,
        start,
    )
    tables, cards = _train_all(asked, planned, limit, device, folder)
    if name == _REDUCTION:
        tables = _compared(asked, planned, cards, device)
        keep_tables(folder, tables)
    save_figure(experiment_figure(asked.title, cards, asked.baseline), folder / "scores.png")
    print_tables(tables, format)
    say(f"table        {folder / 'scores.md'}, scores.csv")


def _train_all(
    asked: Experiment, planned: Sequence[Trial], limit: float | None, device: str, folder: Path
) -> tuple[list[Table], list[tuple[str, Card]]]:
    """Return tables and cards of all trainings; what there is so far lies in the folder."""
    from dfdbench.training.experiments import experiment_table, run_trial
    from dfdbench.training.task import LOGGED

    cards: list[tuple[str, Card]] = []
    tables: list[Table] = []
    for number, trial in enumerate(planned, 1):
        label = f"{number} of {len(planned)}: {trial.folder.name}"
        with progress(label) as bar:
            card = run_trial(trial, limit, device, stepping(bar))
        cards.append((trial.value, card))
        tables = [experiment_table(asked, cards, protocol) for protocol in LOGGED]
        keep_tables(folder, tables)
    return tables, cards


def _compared(
    asked: Experiment, trained: Sequence[Trial], cards: Sequence[tuple[str, Card]], device: str
) -> list[Table]:
    from dfdbench.training.reduction.reduce import comparison_table, seconds_an_image
    from dfdbench.training.task import LOGGED
    from dfdbench.training.trainer import WEIGHTS

    files = {trial.value: trial.folder / WEIGHTS for trial in trained}
    seconds = seconds_an_image(files, trained[0].task.store, device)
    return [comparison_table(asked.title, cards, seconds, protocol) for protocol in LOGGED]


def _rows_of(
    name: str, rows: Path | None, chosen: list[Any] | None, config: str
) -> dict[str, str] | None:
    from dfdbench.training.reduction.reduce import configurations_in

    if rows is None:
        return None
    if name != _REDUCTION:
        raise InputError(f"{name} has no rows", where="--rows", fix="leave it out")
    if config != _PUBLISHED:
        raise InputError(
            "each row brings its own configuration",
            where="--config",
            got=config,
            fix="leave it out; dfdbench thesis reduce takes it",
        )
    return configurations_in(rows, chosen)


def _data_of(
    asked: Experiment,
    name: str,
    dataset: str | None,
    chosen: list[Any] | None,
    source: Path | None,
    cache: Path | None,
) -> tuple[Dataset | dict[str, Dataset], str]:
    from dfdbench.training.experiments import PAIR

    if asked.varies == PAIR:
        manifest = find_manifest(dataset or "realworld")
        return _built_pairs(manifest, chosen or asked.values, source, cache), manifest.stem
    if source:
        raise InputError(f"{name} reads a built data set", where="--source", expected="--dataset")
    store = open_dataset(dataset or "middlebury", cache=cache)
    return store, store.path.stem


def _built_pairs(
    manifest: Manifest, pairs: Sequence[Any], source: Path | None, cache: Path | None
) -> dict[str, Dataset]:
    sets = voltage_pair_sets(manifest, pairs, source, cache)
    for pair, files in sets.to_build.items():
        with progress(f"building {manifest.stem}, steps {pair}") as step:
            report = build_store(manifest, files, sets.places[pair], None, pool_of(None), step)
        pairs_built = counted(report.pairs, "pair")
        say(f"built        {report.path}: {pairs_built}, {len(report.missing)} missing")
    return {pair: Dataset(place) for pair, place in sets.places.items()}


def keep_tables(folder: Path, tables: Sequence[Table]) -> None:
    """Write tables as Markdown and CSV."""
    for format, suffix in ((Format.markdown, "md"), (Format.csv, "csv")):
        write_whole(folder / f"scores.{suffix}", render(tables, format))


def _listed(text: str | None) -> list[Any] | None:
    if text is None:
        return None
    values = [part.strip() for part in text.split(",")]
    if not all(values):
        raise InputError(
            "not a list of values", where="--values", expected="as 0,1,2", got=repr(text)
        )
    return [value_of(value, "--values") for value in values]


class Rounding(StrEnum):
    """To which multiples of 8 widths are rounded."""

    H = "H"
    L = "L"


class Tuning(StrEnum):
    """What moves a neuron of a map after the first 100 epochs."""

    own = "own"
    neighbours = "neighbours"


def reduce(
    weights: Annotated[
        str,
        typer.Option(
            metavar="FILE", help="Weights of a DfD-Net: a file, or the name of shipped ones."
        ),
    ],
    dataset: DataSet = "middlebury",
    split: Annotated[
        str, typer.Option(help="Sample the first pair of each scene of this split.")
    ] = "test",
    level: Annotated[
        int | None,
        typer.Option(help="Iterative rows F of level 1, 2 or 3, in place of the ensemble rows B."),
    ] = None,
    rounds: Annotated[
        Rounding | None, typer.Option(help="Also round to multiples of 8, up (H) or down (L).")
    ] = None,
    config: Configuration = "published",
    changes: Changes = None,
    seed: Seed = 0,
    tuning: Annotated[
        Tuning,
        typer.Option(help="After 100 epochs a neuron follows its own inputs, or its neighbours'."),
    ] = Tuning.own,
    out: Out = None,
    format: Printed = Format.table,
    device: Device = "auto",
    threads: Threads = None,
    cache: Cache = None,
) -> None:
    """Count the different outputs of each layer; write configurations of narrower networks."""
    with needed():
        from dfdbench.methods.networks.inference import find_device
        from dfdbench.methods.networks.weights import find_weights
        from dfdbench.training.configuration import read_configuration
        from dfdbench.training.reduction.reduce import reduce_weights
    use_threads(threads)
    place = find_weights("dfd-net", weights)
    store = open_dataset(dataset, cache=cache)
    configuration = read_configuration(config, values_of(changes, "--set"))
    name = Path(weights).stem + (f"-level{level}" if level else "")
    default = Path("training") / f"{store.path.stem}-reduction" / name
    folder = output_place(default if out is None else out, place)
    with progress("training maps", "nothing was written") as bar:
        found = reduce_weights(
            place,
            store,
            configuration,
            split,
            level,
            rounds.value if rounds else None,
            seed,
            tuning.value,
            find_device(device),
            bar,
        )
    with writing(folder):
        found.write(folder)
    print_tables(found.tables, format)
    say(f"tables       {folder / 'counts.md'}, rows.md, and both as CSV")
    say(f"networks     {', '.join(found.files)} in {folder}")
    say(f"next         dfdbench thesis experiment reduction --dataset {dataset} --rows {folder}")
