"""Weights to smaller networks: count what each layer gives, write configurations to train."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import torch

from dfdbench.datasets.store import Store
from dfdbench.methods.networks.weights import build_network, count_parameters, load_weights
from dfdbench.system.files import write_whole
from dfdbench.tables.render import render
from dfdbench.tables.table import Format, Table
from dfdbench.training.configuration import TrainingConfiguration
from dfdbench.training.reduction.counts import Counts, count_clusters, counts_table, samples_of
from dfdbench.training.reduction.rows import Rounding, Widths, as_toml, rounded, rows_of, rows_table
from dfdbench.training.reduction.self_organising_map import Tuning

#: The row that all others are compared with: the network that was counted, untouched.
BASELINE = "original"


@dataclass(frozen=True)
class Reduction:
    """What a network's layers were counted to give, and the networks that follow.

    Parameters
    ----------
    counts : Counts
        By layer.
    rows : mapping of str to tuple of int
        Widths by the row's name, input to output, `BASELINE` first.
    tables : tuple of Table
        The counts, as Table D.1, and the rows, as Table D.2.
    files : mapping of str to str
        A configuration for each row, by file name.
    """

    counts: Counts
    rows: Mapping[str, Widths]
    tables: tuple[Table, Table]
    files: Mapping[str, str]

    def write(self, folder: Path) -> None:
        """Write tables and configurations; those of an earlier call are replaced."""
        folder.mkdir(parents=True, exist_ok=True)
        for old in folder.glob("*.toml"):
            old.unlink()
        for name, text in self.files.items():
            write_whole(folder / name, text)
        for name, table in zip(("counts", "rows"), self.tables, strict=True):
            for format, suffix in ((Format.markdown, "md"), (Format.csv, "csv")):
                write_whole(folder / f"{name}.{suffix}", render([table], format))


def reduce_weights(
    weights: Path,
    store: Store,
    configuration: TrainingConfiguration,
    split: str = "test",
    level: int | None = None,
    rounding: Rounding | None = None,
    seed: int = 0,
    tuning: Tuning = "own",
    device: torch.device | None = None,
    on_map: Callable[[int, int], None] | None = None,
) -> Reduction:
    """Count the different outputs of each layer of a trained DfD-Net, and cut its widths so (6.2).

    Parameters
    ----------
    weights : Path
        What ``dfdbench train dfd-net`` wrote.
    store : Store
        Where the samples lie, the first pair of each scene.
    configuration : TrainingConfiguration
        How the rows are to be trained; widths and layers are those of the weights.
    split : str
        Whose scenes are sampled; the thesis takes the test's.
    level : int, optional
        The iterative rows F of this level; else the ensemble rows B.
    rounding : {"H", "L"}, optional
        Adds each row rounded up or down to multiples of 8.
    seed, tuning
        Of the maps, see `dfdbench.training.reduction.counts.count_clusters`.
    device : torch.device, optional
        Where the network runs, by default the processor.
    on_map : callable, optional
        Called with (maps done, maps to do).

    Raises
    ------
    MethodError
        Where the weights cannot be read or are of another network.
    InputError
        Where a sample is too small, or there is no such level.
    """
    network, card = load_weights(weights, "dfd-net")
    network = network.to(device or torch.device("cpu"))
    counts = count_clusters(network, store, samples_of(store, split), seed, tuning, on_map)
    base = tuple(int(width) for width in card.architecture["filters"])
    found = rows_of(counts, base, level)
    rows = {BASELINE: base, **found, **(rounded(found, rounding) if rounding else {})}
    # What else the network is made of stays: the row trains the same layers, only narrower ones.
    kept = {
        name: value
        for name, value in card.architecture.items()
        if name in TrainingConfiguration.model_fields and name != "filters"
    }
    same = configuration.model_copy(update=kept)
    what = f"{weights.stem}, {card.trained_on}"
    counted = f"counted on {store.manifest.stem}, split {split}, one pair a scene"
    files = {
        f"{name}.toml": as_toml(same, widths, f"{name} of {what}; {counted}.")
        for name, widths in rows.items()
    }
    parameters = {name: _parameters(card.architecture, widths) for name, widths in rows.items()}
    tables = (
        counts_table(counts, f"Clusters of each layer's outputs: {what}; {counted}"),
        rows_table(rows, parameters, f"Filters of the reduced networks: {what}"),
    )
    return Reduction(counts, rows, tables, files)


def _parameters(architecture: Mapping[str, object], widths: Widths) -> int:
    with torch.device("meta"):
        return count_parameters(build_network("dfd-net", {**architecture, "filters": list(widths)}))
