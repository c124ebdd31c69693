"""Propose splits and folds whose training covers the depths of their tests."""

import itertools
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dfdbench.audit.coverage import USUAL, Criterion, Rule
from dfdbench.audit.leaks import scene_hashes, scenes_alike
from dfdbench.audit.sides import as_ranges, scene_histograms
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import InputError
from dfdbench.system.text import as_json
from dfdbench.tables.table import Table, counted, percent

#: Up to this many choices are all judged; if there are more, this many are drawn at random.
EXHAUSTIVE_LIMIT = 300_000
_CHUNK = 4096
_RESTARTS = 40
Group = tuple[str, ...]


@dataclass(frozen=True)
class Candidate:
    """One test set of a split, or of a fold.

    Parameters
    ----------
    test : tuple of str
        Its scenes; all others train.
    uncovered : float
        Share of the test's known pixels on levels that are not covered.
    overlap : float
        How similar the depths of test and training are: the common area of their histograms, each
        of area 1.
    covered : bool
        Whether the uncovered share is small enough; by default it must be 0.
    """

    test: Group
    uncovered: float
    overlap: float
    covered: bool

    @property
    def order(self) -> tuple[float, float, Group]:
        """The sort key of candidates, best first."""
        return (0.0 if self.covered else self.uncovered, -self.overlap, self.test)


@dataclass(frozen=True)
class Ranking:
    """Candidates, best first, and whether they are all that exist."""

    candidates: tuple[Candidate, ...]
    exhaustive: bool

    @property
    def covered(self) -> int:
        """How many candidates are covered."""
        return sum(candidate.covered for candidate in self.candidates)

    def rank(self, test: Sequence[str]) -> int | None:
        """Return the rank of a test set, from 1, or None if it is not among them."""
        ranked = enumerate((set(candidate.test) for candidate in self.candidates), 1)
        return next((number for number, scenes in ranked if scenes == set(test)), None)


@dataclass(frozen=True)
class Hopeless:
    """A scene whose fold is uncovered whatever else is in it, and the levels at fault."""

    scene: str
    levels: str
    least: float


@dataclass(frozen=True)
class Scenes:
    """The scenes to choose from.

    Parameters
    ----------
    names : tuple of str
        In the manifest's order.
    counts : ndarray of int64, shape (scenes, 256)
        Known pixels of each level, weighted by pairs.
    groups : tuple of tuple of str
        Scenes to keep together (`dfdbench.audit.leaks.scenes_alike`).
    rule : Rule
        When a level, and a test, is uncovered.
    """

    names: Group
    counts: NDArray[np.int64]
    groups: tuple[Group, ...]
    rule: Rule = USUAL

    def judge(self, tests: Sequence[Group]) -> list[Candidate]:
        """Return a candidate for each test set."""
        place = {name: number for number, name in enumerate(self.names)}
        judged = []
        for start in range(0, len(tests), _CHUNK):
            part = tests[start : start + _CHUNK]
            member = np.zeros((len(part), len(self.names)), np.int64)
            for row, test in enumerate(part):
                member[row, [place[name] for name in test]] = 1
            in_test = member @ self.counts
            sides = in_test, self.counts.sum(axis=0) - in_test
            shares = [side / np.maximum(side.sum(axis=1, keepdims=True), 1) for side in sides]
            overlaps = np.minimum(*shares).sum(axis=1)
            numbers = zip(part, self.uncovered(in_test), overlaps.tolist(), strict=True)
            judged += [
                Candidate(test, share, round(overlap, 12), share <= self.rule.allowed_share)
                for test, share, overlap in numbers
            ]
        return judged

    def uncovered(self, tests: NDArray[np.int64]) -> list[float]:
        """Return the uncovered share of each test, of counts of shape (tests, 256)."""
        levels = self.rule.uncovered(self.counts.sum(axis=0) - tests, tests)
        shares = np.where(levels, tests, 0).sum(axis=1) / np.maximum(tests.sum(axis=1), 1)
        return [float(share) for share in shares]

    def alone(self, name: str, criterion: Criterion | None = None) -> NDArray[np.bool_]:
        """Return the levels that the other scenes do not cover when this one is tested alone."""
        own = self.counts[self.names.index(name)]
        return self.rule.uncovered(self.counts.sum(axis=0) - own, own, criterion)

    def divided_by(self, test: Group) -> list[str]:
        """Return the scenes of a test that should stay with others, which it leaves out."""
        left = {name for group in self.groups if not {*group} <= {*test} for name in group}
        return [name for name in test if name in left]


def rank_tests(scenes: Scenes, size: int, seed: int = 0, also: Group = ()) -> Ranking:
    """Rank every test set of a size, by uncovered share, then by overlap.

    Parameters
    ----------
    scenes : Scenes
        What to choose from; groups are never split.
    size : int
        Number of scenes in the test.
    seed : int
        Seed of the draw, if there are more than `EXHAUSTIVE_LIMIT` choices.
    also : tuple of str
        A test set to rank even if it would not be drawn, or splits groups.

    Raises
    ------
    InputError
        If no choice of whole groups has that size.

    Examples
    --------
    >>> counts = np.zeros((3, 256), np.int64)
    >>> counts[:, 80] = 5
    >>> counts[2, 9] = 1
    >>> scenes = Scenes(("A", "B", "C"), counts, (("A",), ("B",), ("C",)))
    >>> [candidate.test for candidate in rank_tests(scenes, 1).candidates]
    [('A',), ('B',), ('C',)]
    """
    possible = _choices(scenes, size)
    if not 0 < size < len(scenes.names) or not possible:
        raise _no_such_size(scenes, size)
    exhaustive = possible <= EXHAUSTIVE_LIMIT
    found = _all_tests(scenes, size) if exhaustive else _drawn_tests(scenes, size, seed)
    tests = list(dict.fromkeys(found))
    if also and len(also) == size and also not in tests:
        tests.append(also)
    ranked = sorted(scenes.judge(tests), key=lambda candidate: candidate.order)
    return Ranking(tuple(ranked), exhaustive)


def _no_such_size(scenes: Scenes, size: int) -> InputError:
    right = [n for n in range(1, len(scenes.names)) if _choices(scenes, n)]
    together = [f"{' and '.join(group)} stay together" for group in scenes.groups if len(group) > 1]
    if not right:
        return InputError("no split divides these scenes", got="; ".join(together))
    whole = right == list(range(1, right[-1] + 1)) and len(right) > 2
    numbers = f"1 to {right[-1]}" if whole else " or ".join(map(str, right))
    expected = "; ".join([f"--test-scenes {numbers}", *together])
    return InputError("no such split", expected=expected, got=f"--test-scenes {size}")


def _choices(scenes: Scenes, size: int) -> int:
    ways = [1] + [0] * size
    for group in scenes.groups:
        for total in range(size, len(group) - 1, -1):
            ways[total] += ways[total - len(group)]
    return ways[size]


def _all_tests(scenes: Scenes, size: int) -> Iterator[Group]:
    # The sizes that each group and those after it can have together, as bits.
    sums = [1]
    for group in reversed(scenes.groups):
        sums.append(sums[-1] | sums[-1] << len(group))

    def choices(first: int, left: int, taken: tuple[Group, ...]) -> Iterator[Group]:
        if not left:
            yield _in_order(scenes, taken)
        for number, group in enumerate(scenes.groups[first:], first + 1):
            rest = left - len(group)
            if rest >= 0 and sums[-1 - number] >> rest & 1:
                yield from choices(number, rest, (*taken, group))

    yield from choices(0, size, ())


def _drawn_tests(scenes: Scenes, size: int, seed: int) -> Iterator[Group]:
    random = np.random.default_rng(seed)
    for _ in range(EXHAUSTIVE_LIMIT):
        groups, left = list[Group](), size
        for number in random.permutation(len(scenes.groups)):
            if len(scenes.groups[number]) <= left:
                groups.append(scenes.groups[number])
                left -= len(scenes.groups[number])
            if not left:
                yield _in_order(scenes, groups)
                break


def _in_order(scenes: Scenes, groups: Sequence[Group]) -> Group:
    chosen = {name for group in groups for name in group}
    return tuple(name for name in scenes.names if name in chosen)


def hopeless_scenes(scenes: Scenes, sizes: set[int]) -> list[Hopeless]:
    """Return the scenes whose fold is not covered whatever else is in it, and why.

    All folds of the given sizes are tried. If there are too many, we judge the scene alone under
    the thesis's criterion: a companion only adds to the test and takes from training, so an
    uncovered level stays uncovered. Its share is least beside the largest companions.
    """
    exhaustive = all(_choices(scenes, size) <= EXHAUSTIVE_LIMIT for size in sizes)
    least = dict.fromkeys(scenes.names, 1.0)
    for size in sizes if exhaustive else ():
        for candidate in rank_tests(scenes, size).candidates:
            for name in candidate.test:
                least[name] = min(least[name], candidate.uncovered)
    found, by_size = [], np.sort(scenes.counts.sum(axis=1))[::-1]
    for name, own in zip(scenes.names, scenes.counts, strict=True):
        by_count = scenes.alone(name, Criterion.thesis)
        proven = scenes.rule.criterion is not Criterion.density and by_count.any()
        if not exhaustive:
            most = int(own.sum() + by_size[: max(sizes) - 1].sum())
            least[name] = float(own[by_count].sum() / most) if proven else 0.0
        if least[name] > scenes.rule.allowed_share:
            levels = by_count if proven else scenes.alone(name)
            found.append(Hopeless(name, as_ranges(levels), least[name]))
    return found


#: A cross validation: each scene in one fold, in the order of their scenes.
Folds = tuple[Candidate, ...]


def not_covered(folds: Folds) -> int:
    """Return how many folds are not covered."""
    return sum(not fold.covered for fold in folds)


def cost(folds: Folds) -> tuple[int, float]:
    """Return the sort key of a partition: uncovered folds, then the sum of their shares."""
    return not_covered(folds), round(math.fsum(fold.uncovered for fold in folds), 12)


def propose_folds(scenes: Scenes, number: int, seed: int = 0) -> list[Folds]:
    """Search partitions into folds, best first: fewest folds uncovered, then smallest share.

    Starting from random partitions, swap two groups as long as that helps; each restart gives one
    proposal. The same seed gives the same proposals.

    Raises
    ------
    InputError
        If there are fewer groups than folds.
    """
    if not 2 <= number <= (most := len(scenes.groups)):
        what = f"{number} folds of {counted(most, 'group')} of scenes"
        fix = f"choose 2 to {most}" if most > 1 else "one group of scenes cannot be divided"
        raise InputError(what, fix=fix)
    random = np.random.default_rng(seed)
    proposals: set[Folds] = set()
    for _ in range(_RESTARTS):
        tests = _improve(scenes, _random_folds(scenes, number, random))
        best = scenes.judge([_in_order(scenes, test) for test in tests])
        proposals.add(tuple(sorted(best, key=lambda fold: scenes.names.index(fold.test[0]))))
    return sorted(proposals, key=lambda folds: (cost(folds), [fold.test for fold in folds]))


def _random_folds(scenes: Scenes, number: int, random: np.random.Generator) -> list[list[Group]]:
    order = [scenes.groups[place] for place in random.permutation(len(scenes.groups))]
    folds: list[list[Group]] = [[] for _ in range(number)]
    for group in sorted(order, key=len, reverse=True):
        min(folds, key=lambda fold: sum(map(len, fold))).append(group)
    return folds


def _improve(scenes: Scenes, folds: list[list[Group]]) -> list[list[Group]]:
    place = {name: number for number, name in enumerate(scenes.names)}
    counts = {g: scenes.counts[[place[name] for name in g]].sum(axis=0) for g in scenes.groups}

    def costs(*tests: NDArray[np.int64]) -> list[tuple[int, float]]:
        pairs = zip(*map(scenes.uncovered, tests), strict=True)
        return [(sum(s > scenes.rule.allowed_share for s in p), round(sum(p), 12)) for p in pairs]

    better = True
    while better:
        better = False
        for a, b in itertools.combinations(folds, 2):
            of_a, of_b = (np.sum([counts[group] for group in fold], axis=0) for fold in (a, b))
            (least,) = costs(of_a[None], of_b[None])
            # All swaps of a group are judged at once, and again from where one of them helped.
            places = [(i, 0) for i in reversed(range(len(a)))]
            while places and least > (0, 0.0):
                i, start = places.pop()
                same = [j for j in range(start, len(b)) if len(b[j]) == len(a[i])]
                moves = np.array([counts[b[j]] - counts[a[i]] for j in same]).reshape(-1, 256)
                swapped = costs(of_a + moves, of_b - moves)
                helped = next((n for n, found in enumerate(swapped) if found < least), None)
                if helped is not None:
                    least, better, j = swapped[helped], True, same[helped]
                    a[i], b[j] = b[j], a[i]
                    of_a, of_b = of_a + moves[helped], of_b - moves[helped]
                    places.append((i, j + 1))
    return folds


#: How many proposals tables and files hold.
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
        (f"{number:,}" + " (published)" * (number == rank), *_cells(manifest, candidate))
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
    """Return the best folds, how the published ones do, and which scenes cannot be covered."""
    best = proposals[0]
    rows = tuple(
        (_fold_name(number), *_cells(manifest, fold), "yes" if fold.covered else "no")
        for number, fold in enumerate(best, 1)
    )
    notes = [_score("best of " + str(len(proposals)) + " found", best)]
    if published:
        score = _score("published folds", published)
        if len(published) == len(best):
            ahead = sum(cost(proposal) < cost(published) for proposal in proposals)
            score += f": {ahead} of {len(proposals)} found are better"
        notes.append(score)
    if hopeless:
        largest = max(len(fold.test) for fold in best)
        notes.append(
            f"{len(hopeless)} scenes leave their fold uncovered whatever else is in it; they fill "
            f"at least {math.ceil(len(hopeless) / largest)} of {len(best)} folds"
        )
    for item in hopeless:
        why = f"rare in all other scenes: {item.levels}" if item.levels else "no level alone is why"
        least = percent(item.least)
        notes.append(f"{item.scene}: {why}; at least {least} of its fold is uncovered")
    columns = ("fold", "test scenes", "pairs", "uncovered", "overlap", "covered")
    return Table(f"folds of {manifest.label}", columns, rows, "llrrrl", tuple(notes))


def split_fragment(manifest: Manifest, test: Sequence[str], train: Sequence[str], why: str) -> str:
    """Format a split as lines for a manifest: partition ``covered``."""
    tables = [
        f'[[splits]]\nname = "{name}"\npartition = "covered"\n'
        f"pairs = {_pair_count(manifest, scenes)}\nscenes = {json.dumps(list(scenes))}\n"
        for name, scenes in (("train-covered", train), ("test-covered", test))
    ]
    return "\n".join([f"# {why}\n", *tables])


def folds_fragment(folds: Folds, why: str) -> str:
    """Format folds as lines for a manifest, to replace its own."""
    tables = [
        f'[[folds]]\nname = "{_fold_name(number)}"\ntest_scenes = {json.dumps(list(fold.test))}\n'
        for number, fold in enumerate(folds, 1)
    ]
    return "\n".join([f"# {why}\n# They replace the manifest's own folds.\n", *tables])


@dataclass(frozen=True)
class Proposal:
    """The result of `propose`: a name, a table, and files by name, with the JSON file first."""

    name: str
    table: Table
    files: dict[str, str]


def propose(store: Dataset, size: int | None, folds: int | None, rule: Rule, seed: int) -> Proposal:
    """Propose test sets of a size, or folds, from the scenes whose depth a store holds.

    Parameters
    ----------
    store : Dataset
        The data set; scenes that look alike stay together.
    size, folds : int or None
        How many scenes to test, or how many folds to make: give one of them.
    rule : Rule
        As in `Scenes`.
    seed : int
        Seed of everything that is drawn.

    Raises
    ------
    InputError
        If both or neither are given; as in `rank_tests` and `propose_folds`.
    """
    if (size is None) == (folds is None):
        raise InputError("ask for either", where="--test-scenes, --folds", fix="--test-scenes 3")
    histograms = {name: h for name, h in scene_histograms(store).items() if h.known}
    groups = scenes_alike(store.manifest, scene_hashes(store, histograms))
    counts = np.stack([histogram.counts for histogram in histograms.values()])
    scenes = Scenes(tuple(histograms), counts, tuple(groups), rule)
    settings: dict[str, object] = {
        "dataset": store.manifest.stem,
        "fingerprint": store.fingerprint,
        **asdict(rule),
        "seed": seed,
        "absent_scenes": [name for name in store.manifest.scene_names if name not in histograms],
        "kept_together": [list(group) for group in groups if len(group) > 1],
    }
    if size is not None:
        return _proposed_tests(store.manifest, scenes, settings, size, seed)
    return _proposed_folds(store.manifest, scenes, settings, folds or 0, seed)


def _proposed_tests(
    manifest: Manifest, scenes: Scenes, settings: dict[str, object], size: int, seed: int
) -> Proposal:
    # Rank it only if all its scenes are built: a part of it would be another test.
    published = manifest.scenes_of("test") if "test" in {s.name for s in manifest.splits} else ()
    published = published if set(published) <= set(scenes.names) else ()
    ranking = rank_tests(scenes, size, seed, published)
    # The published test may divide scenes that look alike: then it is covered by their copies.
    best = next(c.test for c in ranking.candidates if not scenes.divided_by(c.test))
    count = len(ranking.candidates)
    train = tuple(name for name in scenes.names if name not in best)
    why = f"first of {count:,} ({_chosen_by(manifest, scenes, seed)})"
    content = as_json(
        "split",
        **settings,
        choices=count,
        exhaustive=ranking.exhaustive,
        covered=ranking.covered,
        published={"test": published, "rank": ranking.rank(published)},
        candidates=ranking.candidates[:SHOWN],
    )
    verb = f"dfdbench audit split {manifest.short} --test-scenes {size}"
    fragment = split_fragment(manifest, best, train, f"{verb}: {why}")
    table = ranked_splits_table(manifest, ranking, published, scenes.rule.criterion)
    if divided := scenes.divided_by(published):
        note = f"the published test parts {', '.join(divided)} from scenes that look alike"
        table = replace(table, notes=(*table.notes, note))
    return Proposal(f"test-{size}", table, {"split.json": content, "split.toml": fragment})


def _proposed_folds(
    manifest: Manifest, scenes: Scenes, settings: dict[str, object], number: int, seed: int
) -> Proposal:
    proposals = propose_folds(scenes, number, seed)
    best = proposals[0]
    hopeless = hopeless_scenes(scenes, {len(fold.test) for fold in best})
    tests = [tuple(n for n in fold.test_scenes if n in scenes.names) for fold in manifest.folds]
    published = tuple(scenes.judge([test for test in tests if test]))
    kept = [{"not_covered": not_covered(p), "folds": p} for p in (published, *proposals)]
    content = as_json(
        "split, folds",
        **settings,
        published=kept[0] if published else None,
        proposals=kept[1 : SHOWN + 1],
        cannot_be_covered=hopeless,
    )
    chosen_by = _chosen_by(manifest, scenes, seed)
    why = f"dfdbench audit split {manifest.short} --folds {number} ({chosen_by})"
    table = folds_table(manifest, proposals, hopeless, published)
    files = {"folds.json": content, "folds.toml": folds_fragment(best, why)}
    return Proposal(f"folds-{number}", table, files)


def _chosen_by(manifest: Manifest, scenes: Scenes, seed: int) -> str:
    rule, factor, floor = scenes.rule, scenes.rule.density_factor, scenes.rule.density_floor
    said = f"criterion {rule.criterion}, seed {seed}"
    usual = (factor, floor) == (USUAL.density_factor, USUAL.density_floor)
    if rule.criterion is not Criterion.thesis and not usual:
        said += f", density factor {factor:g}, floor {floor:g}"
    if rule.allowed_share:
        said += f", allowed share {rule.allowed_share:g}"
    absent = [name for name in manifest.scene_names if name not in scenes.names]
    return said + (f"; without {', '.join(absent)}, which the store lacks" if absent else "")


def _cells(manifest: Manifest, candidate: Candidate) -> tuple[str, ...]:
    pairs = str(_pair_count(manifest, candidate.test))
    shares = percent(candidate.uncovered), f"{candidate.overlap:.3f}"
    return ", ".join(candidate.test), pairs, *shares


def _pair_count(manifest: Manifest, scenes: Sequence[str]) -> int:
    return sum(pair.scene in scenes for pair in manifest.pairs())


def _fold_name(number: int) -> str:
    # Unlike the thesis's folds, which are K01, K02, ...
    return f"C{number:02d}"


def _score(what: str, folds: Folds) -> str:
    worst = max(folds, key=lambda fold: fold.uncovered)
    return (
        f"{what}: {not_covered(folds)} of {len(folds)} not covered, at worst "
        f"{percent(worst.uncovered)} ({', '.join(worst.test)})"
    )


def _why_unranked(published: Sequence[str], size: int) -> str:
    if not published:
        return "the manifest has no published split that can be ranked with the scenes built"
    return f"the published test has {len(published)} scenes, not {size}: it has no rank among these"
