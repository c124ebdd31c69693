"""Proposed splits and folds as tables and as fragments of a manifest."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from dfdbench.audit.splits import Candidate, Folds, Hopeless, Ranking, Scenes
from dfdbench.datasets.manifest import Manifest
from dfdbench.tables.table import Table
from dfdbench.tables.wording import percent

SCHEMA_VERSION = 1
#: Proposals that tables and files hold.
SHOWN = 10


def ranked_splits_table(
    manifest: Manifest, ranking: Ranking, published: Sequence[str], criterion: str
) -> Table:
    """Return the best test sets, and the published one with its rank."""
    rank = ranking.rank(published)
    chosen = list(enumerate(ranking.candidates[:SHOWN], 1))
    if rank is not None and rank > SHOWN:
        chosen.append((rank, ranking.candidates[rank - 1]))
    rows = tuple(
        (
            f"{number:,}" + (" (published)" if number == rank else ""),
            ", ".join(candidate.test),
            str(_pair_count(manifest, candidate.test)),
            percent(candidate.uncovered),
            f"{candidate.overlap:.3f}",
        )
        for number, candidate in chosen
    )
    count = len(ranking.candidates)
    notes = [
        f"{ranking.covered:,} of {count:,} choices are covered by criterion {criterion}"
        + ("" if ranking.exhaustive else "; drawn at random, there are more"),
        "ranked by the share of the test's pixels on uncovered levels, then by overlap: the area "
        "that the depth histograms of test and training have in common",
    ]
    if rank is None:
        notes.append(_why_unranked(published, len(ranking.candidates[0].test)))
    elif not ranking.candidates[rank - 1].covered:
        notes.append(f"the published test ({', '.join(published)}) is not covered: rank {rank:,}")
    columns = ("rank", "test scenes", "pairs", "uncovered", "overlap")
    rules = frozenset({SHOWN - 1}) if len(rows) > SHOWN else frozenset()
    return Table(f"test sets of {manifest.label}", columns, rows, "rlrrr", tuple(notes), rules)


def folds_table(
    manifest: Manifest, proposals: Sequence[Folds], hopeless: Sequence[Hopeless], published: Folds
) -> Table:
    """Return the best folds, what the published ones reach, and which cannot be covered."""
    best = proposals[0]
    rows = tuple(
        (
            _fold_name(number),
            ", ".join(fold.test),
            str(_pair_count(manifest, fold.test)),
            percent(fold.uncovered),
            f"{fold.overlap:.3f}",
            "yes" if fold.covered else "no",
        )
        for number, fold in enumerate(best.folds, 1)
    )
    notes = [_score("best of " + str(len(proposals)) + " found", best)]
    if published.folds:
        ahead = sum(proposal.cost < published.cost for proposal in proposals)
        notes.append(
            f"{_score('published folds', published)}: {ahead} of {len(proposals)} found are better"
        )
    if hopeless:
        largest = max(len(fold.test) for fold in best.folds)
        least = math.ceil(len(hopeless) / largest)
        notes.append(
            f"{len(hopeless)} scenes leave their fold uncovered whatever else is in it; they fill "
            f"at least {least} of {len(best.folds)} folds"
        )
    notes += [_why_hopeless(item) for item in hopeless]
    columns = ("fold", "test scenes", "pairs", "uncovered", "overlap", "covered")
    return Table(f"folds of {manifest.label}", columns, rows, "llrrrl", tuple(notes))


def split_fragment(manifest: Manifest, test: Sequence[str], train: Sequence[str], why: str) -> str:
    """Return a split as the lines of a manifest: partition ``covered``."""
    tables = [
        f'[[splits]]\nname = "{name}"\npartition = "covered"\n'
        f"pairs = {_pair_count(manifest, scenes)}\nscenes = {json.dumps(list(scenes))}\n"
        for name, scenes in (("train-covered", train), ("test-covered", test))
    ]
    return "\n".join([f"# {why}\n", *tables])


def folds_fragment(folds: Folds, why: str) -> str:
    """Return folds as the lines of a manifest, instead of those that it has."""
    tables = [
        f'[[folds]]\nname = "{_fold_name(number)}"\ntest_scenes = {json.dumps(list(fold.test))}\n'
        for number, fold in enumerate(folds.folds, 1)
    ]
    return "\n".join([f"# {why}\n# They replace the manifest's own folds.\n", *tables])


@dataclass(frozen=True)
class ProposalSettings:
    """What a proposal depends on: the store's fingerprint, the scenes, the draws' seed."""

    fingerprint: str
    scenes: Scenes
    seed: int

    def absent(self, manifest: Manifest) -> list[str]:
        """Return the manifest's scenes that could not be chosen."""
        return [name for name in manifest.scene_names if name not in self.scenes.names]

    def as_dict(self, manifest: Manifest) -> dict[str, object]:
        """Return all of it for JSON."""
        return {
            "fingerprint": self.fingerprint,
            "criterion": self.scenes.criterion,
            "allowed_share": self.scenes.allowed,
            "density_factor": self.scenes.bound.factor,
            "density_floor": self.scenes.bound.floor,
            "seed": self.seed,
            "absent_scenes": self.absent(manifest),
            "kept_together": [list(group) for group in self.scenes.groups if len(group) > 1],
        }


def ranking_as_json(
    manifest: Manifest, settings: ProposalSettings, ranking: Ranking, published: Sequence[str]
) -> str:
    """Return a ranking's best as JSON."""
    content = {
        "format": "dfdbench split",
        "schema_version": SCHEMA_VERSION,
        "dataset": manifest.stem,
        **settings.as_dict(manifest),
        "choices": len(ranking.candidates),
        "exhaustive": ranking.exhaustive,
        "covered": ranking.covered,
        "published": {"test": list(published), "rank": ranking.rank(published)},
        "candidates": [asdict(candidate) for candidate in ranking.candidates[:SHOWN]],
    }
    return json.dumps(content, indent=1) + "\n"


def folds_as_json(
    manifest: Manifest,
    settings: ProposalSettings,
    proposals: Sequence[Folds],
    hopeless: Sequence[Hopeless],
    published: Folds,
) -> str:
    """Return proposed folds as JSON, the best first, and the published ones."""

    def described(folds: Folds) -> dict[str, object]:
        return {"not_covered": folds.not_covered, "folds": [asdict(fold) for fold in folds.folds]}

    content = {
        "format": "dfdbench split, folds",
        "schema_version": SCHEMA_VERSION,
        "dataset": manifest.stem,
        **settings.as_dict(manifest),
        "published": described(published) if published.folds else None,
        "proposals": [described(folds) for folds in proposals[:SHOWN]],
        "cannot_be_covered": [asdict(item) for item in hopeless],
    }
    return json.dumps(content, indent=1) + "\n"


def _pair_count(manifest: Manifest, scenes: Sequence[str]) -> int:
    return sum(pair.scene in scenes for pair in manifest.pairs())


def _fold_name(number: int) -> str:
    # Unlike those of the thesis, which are K01, K02, ...
    return f"C{number:02d}"


def _score(what: str, folds: Folds) -> str:
    worst: Candidate = max(folds.folds, key=lambda fold: fold.uncovered)
    return (
        f"{what}: {folds.not_covered} of {len(folds.folds)} not covered, at worst "
        f"{percent(worst.uncovered)} ({', '.join(worst.test)})"
    )


def _why_hopeless(item: Hopeless) -> str:
    why = f"rare in all other scenes: {item.levels}" if item.levels else "no level alone is why"
    return f"{item.scene}: {why}; at least {percent(item.least)} of its fold is uncovered"


def _why_unranked(published: Sequence[str], size: int) -> str:
    if not published:
        return "the manifest has no published split that can be ranked with the scenes built"
    return f"the published test has {len(published)} scenes, not {size}: it has no rank among these"
