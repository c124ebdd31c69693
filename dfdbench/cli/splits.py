"""The verb that proposes splits: split."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from dfdbench.audit.coverage import Criterion, DensityBound
from dfdbench.audit.leaks import scene_hashes, scenes_alike
from dfdbench.audit.sides import scene_histograms
from dfdbench.audit.split_tables import (
    ProposalSettings,
    folds_as_json,
    folds_fragment,
    folds_table,
    ranked_splits_table,
    ranking_as_json,
    split_fragment,
)
from dfdbench.audit.splits import Folds, Scenes, hopeless_scenes, propose_folds, rank_tests
from dfdbench.cli.answer import Answer, AnswerFormat, give
from dfdbench.cli.completion import data_sets
from dfdbench.cli.coverage import AllowOption, CriterionOption, FactorOption, FloorOption
from dfdbench.datasets.dataset import Dataset, open_dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError
from dfdbench.results.output_place import output_place


def split_command(
    dataset: Annotated[
        str, typer.Argument(help="A data set's name or a store's path.", autocompletion=data_sets)
    ],
    test_scenes: Annotated[
        int | None, typer.Option(min=1, help="Propose test splits of this many scenes.")
    ] = None,
    folds: Annotated[
        int | None, typer.Option(min=2, help="Propose this many folds instead.")
    ] = None,
    criterion: CriterionOption = Criterion.either,
    allow: AllowOption = 0.0,
    density_factor: FactorOption = DensityBound.factor,
    density_floor: FloorOption = DensityBound.floor,
    seed: Annotated[
        int,
        typer.Option(
            min=0, help="Seed for drawing folds, and splits where there are too many to try all."
        ),
    ] = 0,
    out: Annotated[
        str | None, typer.Option(help="Folder; default: results/DATASET-splits/...")
    ] = None,
    format: Annotated[
        AnswerFormat, typer.Option(help="How the answer is printed.")
    ] = AnswerFormat.table,
) -> None:
    """Propose splits or folds by scene whose training covers their tests' depths."""
    if (test_scenes is None) == (folds is None):
        raise InputError(
            "ask for one thing", where="--test-scenes or --folds", fix="--test-scenes 3"
        )
    store = open_dataset(dataset)
    bound = DensityBound(density_factor, density_floor)
    scenes = _scenes(store, criterion, bound, allow)
    settings = ProposalSettings(store.fingerprint, scenes, seed)
    if test_scenes is not None:
        _propose_tests(store.manifest, settings, test_scenes, _Place(store, out), format)
    elif folds is not None:
        _propose_folds(store.manifest, settings, folds, _Place(store, out), format)


@dataclass(frozen=True)
class _Place:
    store: Dataset
    out: str | None

    def folder(self, name: str) -> Path:
        default = Path("results") / f"{self.store.path.stem}-splits" / name
        return output_place(default if self.out is None else self.out)


def _told(manifest: Manifest, settings: ProposalSettings) -> str:
    scenes, absent = settings.scenes, settings.absent(manifest)
    told = f"criterion {scenes.criterion}, seed {settings.seed}"
    if scenes.criterion is not Criterion.thesis and scenes.bound != DensityBound():
        told += f", density factor {scenes.bound.factor:g}, floor {scenes.bound.floor:g}"
    if scenes.allowed:
        told += f", allowed share {scenes.allowed:g}"
    return told + (f"; without {', '.join(absent)}, which the store lacks" if absent else "")


def _propose_tests(
    manifest: Manifest, settings: ProposalSettings, size: int, place: _Place, format: AnswerFormat
) -> None:
    scenes = settings.scenes
    published = _published_test(manifest, scenes)
    ranking = rank_tests(scenes, size, settings.seed, published)
    best = ranking.candidates[0].test
    train = tuple(name for name in scenes.names if name not in best)
    why = (
        f"dfdbench audit split {manifest.short} --test-scenes {size}: first of "
        f"{len(ranking.candidates):,} ({_told(manifest, settings)})"
    )
    content = ranking_as_json(manifest, settings, ranking, published)
    fragment = split_fragment(manifest, best, train, why)
    folder = place.folder(f"test-{size}")
    answer = Answer(content, (ranked_splits_table(manifest, ranking, published, scenes.criterion),))
    give(answer, format, folder, {"split.toml": fragment, "split.json": content})


def _propose_folds(
    manifest: Manifest, settings: ProposalSettings, number: int, place: _Place, format: AnswerFormat
) -> None:
    scenes = settings.scenes
    proposals = propose_folds(scenes, number, settings.seed)
    best = proposals[0]
    hopeless = hopeless_scenes(scenes, {len(fold.test) for fold in best.folds})
    tests = [
        tuple(name for name in fold.test_scenes if name in scenes.names) for fold in manifest.folds
    ]
    published = Folds(tuple(scenes.judge([test for test in tests if test])))
    why = f"dfdbench audit split {manifest.short} --folds {number} ({_told(manifest, settings)})"
    content = folds_as_json(manifest, settings, proposals, hopeless, published)
    folder = place.folder(f"folds-{number}")
    answer = Answer(content, (folds_table(manifest, proposals, hopeless, published),))
    files = {"folds.toml": folds_fragment(best, why), "folds.json": content}
    give(answer, format, folder, files)


def _scenes(store: Dataset, criterion: Criterion, bound: DensityBound, allow: float) -> Scenes:
    histograms = {name: h for name, h in scene_histograms(store).items() if h.known}
    groups = scenes_alike(store.manifest, scene_hashes(store, histograms))
    counts = np.stack([histogram.counts for histogram in histograms.values()])
    return Scenes(tuple(histograms), counts, tuple(groups), criterion, bound, allow)


def _published_test(manifest: Manifest, scenes: Scenes) -> tuple[str, ...]:
    # Ranked only where all its scenes are built: a part of it is another test.
    names = {split.name for split in manifest.splits}
    test = manifest.scenes_of("test") if "test" in names else ()
    return test if set(test) <= set(scenes.names) else ()
