from __future__ import annotations

import math
from pathlib import Path

import pytest

from tests.cli.command import Command

SIMULATE = ["simulate", "realworld", "--steps", "129,141", "--exposures", "40"]


def test_a_figure_replaces_no_other_file(dfdbench: Command) -> None:
    Path("README.md").write_text("precious")
    lens = ["--f-number", "3.7", "--focal-length", "9.6mm", "--focus", "0.5m", "--pixel", "4.8um"]
    done = dfdbench("optics", "blur", *lens, "--out", "README.md")
    assert (done.status, "figures are PNG files" in done.err) == (2, True)
    assert Path("README.md").read_text() == "precious"


@pytest.mark.parametrize("cell", ["nan", "inf"])
def test_a_lens_table_without_numbers_is_told(dfdbench: Command, cell: str) -> None:
    Path("lens.csv").write_text(f"step,1.5,1.8,2.2\n129,1,2,{cell}\n141,4,5,6\n")
    done = dfdbench("optics", "pairs", "--lens", "lens.csv")
    assert (done.status, "not a number" in done.err) == (2, True)
    Path("lens.csv").write_text(f"step,1.5,{cell},2.2\n129,1,2,3\n141,4,5,6\n")
    assert dfdbench("optics", "pairs", "--lens", "lens.csv").status == 2


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (["--pixel", "4.8m"], "1mm at most"),
        (["--f-number", "-1"], "--f-number"),
        (["--focus", "1mm"], "--focus"),
        (["--range", "5mm", "8mm"], "beyond the focal length"),
        (["--out", "blur.jpg"], "figures are PNG files"),
    ],
)
def test_a_lens_that_cannot_be_is_told_by_its_options(
    dfdbench: Command, given: list[str], told: str
) -> None:
    lens = {"--f-number": "3.7", "--focal-length": "9.6mm", "--focus": "0.5m", "--pixel": "4.8um"}
    kept = [text for option in lens.items() if option[0] not in given for text in option]
    done = dfdbench("optics", "blur", *kept, *given)
    assert (done.status, told in done.err, done.out) == (2, True, ""), done.err


def pairs_of(*points: tuple[float, float]) -> str:
    return "".join(f"[[pairs]]\nlidar = [{x}, {y}]\nimage = [{x}, {y}]\n" for x, y in points)


def test_depth_maps_without_a_known_pixel_are_not_built(dfdbench: Command) -> None:
    assert dfdbench(*SIMULATE, "--out", "raw", "--scenes", "k03").status == 0
    assert dfdbench("register", "k03", "--source", "raw").status == 0
    registration = Path("raw/k03/registration.toml")
    build = ["build", "realworld", "--source", "raw", "--allow-missing"]
    for content, told in (
        ("matrix = [[1,0,99999],[0,1,99999],[0,0,1]]\n", "no LIDAR return falls on the image"),
        ("pairs = 5\n", "too few pairs of points"),
        (
            "".join(f"[[pairs]]\nlidar = [{n}, {n}]\nimage = [{n}, {n}]\n" for n in range(4)),
            "the points lie on one line",
        ),
        (pairs_of((10, 10), (500, 10), (10, 500), (10, 500)), "two pairs share a point"),
        (pairs_of((math.nan, 3), (500, 10), (10, 500), (500, 500)), "not a point"),
        ("matrix = [[1,0,0],[0,1,0],[0,0,1]]\npairs = []\n", "a matrix and pairs"),
    ):
        registration.write_text(content)
        done = dfdbench(*build)
        assert (done.status, told in done.err) == (2, True), done.err
        assert "Traceback" not in done.err


@pytest.mark.parametrize("altitude", ["nan", "900"])
def test_beams_that_point_nowhere_are_told(tmp_path: Path, altitude: str) -> None:
    from dfdbench.errors import SourceError
    from dfdbench.rig.lidar_files import read_beams

    path = tmp_path / "beams.csv"
    path.write_text(f"beam,altitude_deg,azimuth_deg,azimuth_index\n0,{altitude},3.1,18\n")
    with pytest.raises(SourceError, match="degrees, 90 at most"):
        read_beams(path)
