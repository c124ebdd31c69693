"""Tables out of comparisons of a test with its training."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping

from dfdbench.audit.coverage import Criterion, Verdict
from dfdbench.audit.coverage_record import CoverageRecord, RangeRecord, SideRecord
from dfdbench.tables.table import Table
from dfdbench.tables.wording import counted, listed, percent

SCHEMA_VERSION = 1
_SCENES_NAMED = 4
_ABSENT_NAMED = 8


def coverage_table(record: CoverageRecord) -> Table:
    """Return the offending ranges of levels with the pixels and scenes they concern."""
    rows = tuple(
        (
            item.levels,
            item.verdict,
            " and ".join(item.criteria),
            percent(item.share),
            f"{item.test_pixels:,}",
            f"{item.train_pixels:,}",
            _scenes_of(item),
        )
        for item in record.ranges
    )
    columns = ("levels", "verdict", "criterion", "share", "in test", "in training", "scenes")
    title = f"depths of {_name(record.test)} that {_name(record.train)} lacks"
    return Table(title, columns, rows, "lllrrrl", tuple(_notes(record)))


def verdict_line(record: CoverageRecord) -> str:
    """Return the comparison's outcome in one line."""
    if record.leaks:
        return f"LEAK: {leak_text(record)}: the test says nothing of new scenes"
    found = (
        f"{percent(record.uncovered_share)} of the test's known pixels lie on levels missing or "
        f"scarce by criterion {record.criterion}"
    )
    allowed = f" ({percent(record.allowed_share)} allowed)" if record.allowed_share else ""
    return f"{'covered' if record.covered else 'NOT covered'}: {found}{allowed}"


def leak_text(record: CoverageRecord) -> str:
    """Return how much the two sides share, e.g. ``training holds 2 scenes of the test``."""
    counts = Counter(leak.kind for leak in record.leaks)
    found = [counted(count, kind) for kind, count in counts.items()]
    return f"training holds {' and '.join(found)} of the test"


def each_table(records: Mapping[str, CoverageRecord], kind: str) -> Table:
    """Return a row for each scene or fold tested against all other scenes."""
    rows = tuple(
        (
            name,
            ", ".join(record.test.scenes) if kind == "fold" else str(record.test.pairs),
            percent(record.shares["thesis"]),
            record.ranges_of(Criterion.thesis) or "–",
            percent(record.shares["density"]),
            record.ranges_of(Criterion.density) or "–",
            record.ranges_of(Verdict.missing) or "–",
        )
        for name, record in records.items()
    )
    columns = (
        kind,
        "test scenes" if kind == "fold" else "pairs",
        "thesis",
        "levels",
        "density",
        "levels",
        "missing",
    )
    first = next(iter(records.values()))
    notes = [
        "share of the test's known pixels on levels that are not covered by criterion thesis and "
        "by criterion density, and which; missing ones count in the first"
    ]
    absent = sorted({scene for r in records.values() for scene in _absent(r)})
    if absent:
        notes.append(f"not in the store, so on neither side: {', '.join(absent)}")
    title = f"each {kind} of {first.test.label} against all other scenes"
    align = "llrlrll" if kind == "fold" else "lrrlrll"
    return Table(title, columns, rows, align, tuple(notes))


def each_as_json(records: Mapping[str, CoverageRecord], kind: str) -> str:
    """Return the records of `each_table` as JSON, by scene or fold."""
    content = {
        "format": f"dfdbench coverage, each {kind}",
        "schema_version": SCHEMA_VERSION,
        "records": {name: record.model_dump(mode="json") for name, record in records.items()},
    }
    return json.dumps(content, indent=1) + "\n"


def _notes(record: CoverageRecord) -> list[str]:
    shares, as_crops = record.shares, record.expanded_shares
    notes = [
        "share: of the known test pixels; in test, in training: pixels, each depth map once for "
        "each of its pairs; scenes: of the test, with their parts of the range's pixels",
        f"missing: in the test, never in training: {percent(shares['missing'])} of "
        f"{record.test.known_pixels:,} known test pixels; {record.test.unknown_pixels:,} are "
        "unknown and left out",
        "thesis: more pixels in the test than in training, pairs weighted by their lightings: "
        f"{percent(shares['thesis'])}; as 32 x 32 crops {percent(as_crops['thesis'])}",
        f"density: {record.density_factor:g} times the share in training, and at least "
        f"{percent(record.density_floor)} of the test: {percent(shares['density'])}; as crops "
        f"{percent(as_crops['density'])}",
    ]
    if record.test.inverted:
        notes.append("the test's levels were turned round, 255 - level (Eq. 7.1), to mean the same")
    notes += [
        f"not in the store, so not counted in {side.split}: "
        + listed(side.absent_scenes, _ABSENT_NAMED)
        for side in (record.train, record.test)
        if side.absent_scenes
    ]
    return notes


def _absent(record: CoverageRecord) -> list[str]:
    return record.train.absent_scenes + record.test.absent_scenes


def _name(side: SideRecord) -> str:
    scenes = counted(len(side.scenes), "scene")
    return f"{side.label}, {side.split} ({counted(side.pairs, 'pair')} of {scenes})"


def _scenes_of(item: RangeRecord) -> str:
    named = [f"{name} {percent(share)}" for name, share in item.scenes.items()]
    more = len(named) - _SCENES_NAMED
    return ", ".join(named[:_SCENES_NAMED]) + (f", {more} more" if more > 0 else "")
