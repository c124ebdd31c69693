import json

import numpy as np

from dfdbench.audit.difficulty import UNSEEN, Difficulty
from dfdbench.audit.difficulty_tables import difficulty_as_json, difficulty_rows, difficulty_table
from dfdbench.datasets.manifest import Manifest, Pair


def of(*steps: int, known: bool = True) -> Difficulty:
    return Difficulty(np.array([steps]), np.full((1, len(steps)), known))


def rows(manifest: Manifest) -> list[dict[str, object]]:
    found: dict[Pair, Difficulty] = {}
    for pair in manifest.pairs("train"):
        # View 5 is harder than view 1, and exposure 0 shows nothing.
        shown = of(1, 1, 2, 64) if pair.at["view"] == 1 else of(64, 64, 64, 128)
        found[pair] = of(*[UNSEEN] * 4) if pair.at["exposure"] == 0 else shown
    for pair in manifest.pairs("K2"):
        found[pair] = of(1, known=False)
    return difficulty_rows(manifest, found)


def test_a_row_takes_the_views_of_a_lighting_together(tiny_manifest: Manifest) -> None:
    dark, bright = rows(tiny_manifest)[:2]
    assert (dark["scene"], dark["exposure"], bright["exposure"]) == ("One", 0, 1)
    assert (dark["neighbours"], dark["coarse"], dark["median_step"]) == (1.0, 1.0, UNSEEN)
    # Means over both views of 2 of 4 and 4 of 4, of 1 of 4 and 4 of 4; the fourth of 8 steps.
    assert (bright["neighbours"], bright["coarse"]) == (0.75, 0.625)
    assert bright["median_step"] == 64


def test_no_step_reads_none_and_no_pixel_a_dash(tiny_manifest: Manifest) -> None:
    table = difficulty_table(tiny_manifest, rows(tiny_manifest), 3)
    assert table.columns == (
        "scene",
        "illumination",
        "exposure",
        "1 apart",
        "32 apart",
        "median step",
    )
    assert table.rows[0] == ("One", "1", "0", "100.0 %", "100.0 %", "none")
    assert table.rows[1] == ("One", "1", "1", "75.0 %", "62.5 %", "64")
    assert table.rows[2][3:] == ("–", "–", "–")
    assert any("by more than 3 grey levels" in note for note in table.notes)


def test_json_has_numbers_and_null_where_there_is_none(tiny_manifest: Manifest) -> None:
    content = json.loads(difficulty_as_json(tiny_manifest, "f" * 64, 3, rows(tiny_manifest)))
    assert (content["dataset"], content["noise"]) == ("tiny-1", 3)
    dark, bright, unknown = content["rows"][:3]
    assert (dark["neighbours"], dark["median_step"]) == (1.0, None)
    assert bright["median_step"] == 64
    assert (unknown["neighbours"], unknown["coarse"], unknown["median_step"]) == (None, None, None)
