import hashlib
from importlib import resources
from pathlib import Path

import pytest

from dfdbench.errors import InputError, SourceError
from dfdbench.optics.lens_table import (
    pair_difference,
    parse_lens_table,
    rank_pairs,
    read_lens_table,
)

# Thesis, Table 7.5: absolute difference of the quantised blur radii at 1.5, 1.6, ... 2.2 m.
TABLE_7_5 = {
    (142, 130): (4, 4, 5, 5, 5, 6, 7, 7),
    (141, 132): (5, 5, 6, 6, 7, 7, 7, 8),
    (141, 131): (4, 4, 5, 5, 5, 6, 6, 7),
    (141, 130): (2, 2, 4, 4, 4, 4, 5, 6),
    (141, 129): (1, 1, 2, 2, 3, 3, 3, 4),
    (140, 132): (4, 4, 4, 5, 6, 6, 7, 7),
    (140, 131): (3, 3, 3, 4, 4, 5, 6, 6),
    (140, 130): (1, 1, 2, 3, 3, 3, 5, 5),
    (137, 128): (4, 4, 3, 3, 2, 1, 1, 1),
}


@pytest.mark.parametrize(("steps", "row"), TABLE_7_5.items())
def test_a_row_of_table_7_5_is_reproduced(steps: tuple[int, int], row: tuple[int, ...]) -> None:
    assert pair_difference(read_lens_table(), *steps, 1.5, 2.2).differences == row


def test_every_pair_of_table_7_5_ranks_among_the_least_repeating() -> None:
    ranked = rank_pairs(read_lens_table(), 1.5, 2.2)
    best = [pair for pair in ranked if pair.repeats == ranked[0].repeats]
    names = [pair.name for pair in best]
    assert {f"{first}-{second}" for first, second in TABLE_7_5} <= set(names)
    assert len(best) == 16
    assert names.index("141-129") == 2


def test_the_shipped_table_is_released() -> None:
    folder = resources.files("dfdbench.manifests").joinpath("realworld-1")
    names = ("lens_blur_radius_px.csv", "os1_beams.csv")
    hashes = {hashlib.sha256(folder.joinpath(name).read_bytes()).hexdigest() for name in names}
    assert hashes == {
        "b6e50e10caded2d8b86f7bed51660132225a9b6cb9a3b68ca866abb31f3662c9",
        "2e07edc50f84a03b92201be5a9e620fa59cfd6ac5c8807c7b39706acd36db76c",
    }


def test_the_radius_between_measured_distances_is_interpolated() -> None:
    table = read_lens_table()
    assert table.radius_at(127, [0.4, 0.45, 0.5, 9]).tolist() == [14, 13, 12, 4]
    with pytest.raises(InputError, match="127 to 143"):
        table.radius_at(126, 1.0)


def test_a_broken_table_is_told_with_every_problem(tmp_path: Path) -> None:
    text = "step,1,2,3\n\n10,1,2\n12,1,x,3\n11,1,2.5,3\n"
    with pytest.raises(SourceError) as said:
        parse_lens_table(text, "mine.csv")
    cells, *kinds = [problem.what for problem in said.value.problems]
    assert cells == "3 cells under a heading of 4"
    assert said.value.problems[0].where == "mine.csv: line 3"
    assert kinds == ["not numbers of 0 to 1000000", "not whole steps and pixels"]
    with pytest.raises(SourceError, match="steps do not ascend"):
        parse_lens_table("step,1,2\n12,1,2\n11,1,2\n", "mine.csv")
    with pytest.raises(SourceError, match="not a lens table"):
        parse_lens_table("", "mine.csv")
    with pytest.raises(SourceError, match="cannot read"):
        read_lens_table(tmp_path / "none.csv")
