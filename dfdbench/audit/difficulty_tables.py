"""Difficulty by scene and lighting, as a table and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping

from dfdbench.audit.difficulty import SEEN, STEPS, UNSEEN, Difficulty, median_step
from dfdbench.datasets.manifest import Manifest, Pair
from dfdbench.tables.table import Table
from dfdbench.tables.wording import percent

SCHEMA_VERSION = 1
#: A step that is a useful depth difference: an eighth of the range that 256 levels span.
COARSE = 32


def difficulty_rows(
    manifest: Manifest, found: Mapping[Pair, Difficulty]
) -> list[dict[str, object]]:
    """Return mean shares and median steps by scene and lighting, views taken together."""
    lighting = [axis for axis in manifest.axes if axis not in manifest.depth.axes]
    groups: dict[tuple[str, tuple[int, ...]], list[Difficulty]] = {}
    for pair, difficulty in found.items():
        key = (pair.scene, tuple(pair.at[axis] for axis in lighting))
        groups.setdefault(key, []).append(difficulty)
    return [
        {
            "scene": scene,
            **dict(zip(lighting, values, strict=True)),
            "neighbours": _mean([d.share_above(STEPS[0]) for d in group]),
            "coarse": _mean([d.share_above(COARSE) for d in group]),
            "median_step": median_step(group),
        }
        for (scene, values), group in groups.items()
    ]


def difficulty_table(manifest: Manifest, rows: list[dict[str, object]], noise: int) -> Table:
    """Return the rows as a table."""
    lighting = [axis for axis in manifest.axes if axis not in manifest.depth.axes]
    columns = ("scene", *lighting, "1 apart", f"{COARSE} apart", "median step")
    cells = tuple(
        (
            str(row["scene"]),
            *(str(row[axis]) for axis in lighting),
            _percent(row["neighbours"]),
            _percent(row["coarse"]),
            _step(row["median_step"]),
        )
        for row in rows
    )
    notes = (
        f"1 apart, {COARSE} apart: share of the pixels whose blur cannot tell levels that far "
        "from each other",
        SEEN.format(noise=noise),
        "steps tried: " + ", ".join(map(str, STEPS)),
    )
    align = "l" + "r" * (len(columns) - 1)
    return Table(
        f"what blur does not show of depth in {manifest.label}", columns, cells, align, notes
    )


def difficulty_as_json(
    manifest: Manifest, fingerprint: str, noise: int, rows: list[dict[str, object]]
) -> str:
    """Return the rows as JSON."""
    content = {
        "format": "dfdbench difficulty",
        "schema_version": SCHEMA_VERSION,
        "dataset": manifest.stem,
        "fingerprint": fingerprint,
        "noise": noise,
        "steps": list(STEPS),
        "coarse_step": COARSE,
        "rows": [{key: _as_json(value) for key, value in row.items()} for row in rows],
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n"


def _mean(values: list[float]) -> float:
    defined = [value for value in values if not math.isnan(value)]
    return math.fsum(defined) / len(defined) if defined else math.nan


def _percent(value: object) -> str:
    assert isinstance(value, float)
    return "–" if math.isnan(value) else percent(value)


def _step(value: object) -> str:
    return "–" if value is None else "none" if value == UNSEEN else str(value)


def _as_json(value: object) -> object:
    unseen = value == UNSEEN or (isinstance(value, float) and math.isnan(value))
    return None if unseen else value
