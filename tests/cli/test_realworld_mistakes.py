import math
from pathlib import Path

import pytest

from tests.cli.command import Command

SIMULATE = ["rig", "simulate", "realworld", "--steps", "129,141", "--exposures", "40"]


def pairs_of(*points: tuple[float, float]) -> str:
    return "".join(f"[[pairs]]\nlidar = [{x}, {y}]\nimage = [{x}, {y}]\n" for x, y in points)


@pytest.mark.slow
def test_depth_maps_without_a_known_pixel_are_not_built(dfdbench: Command) -> None:
    assert dfdbench(*SIMULATE, "--out", "raw", "--scenes", "k03").status == 0
    assert dfdbench("rig register k03 --source raw").status == 0
    registration = Path("raw/k03/registration.toml")
    build = ["build", "realworld", "--source", "raw", "--allow-missing"]
    for content, told in (
        ("matrix = [[1,0,99999],[0,1,99999],[0,0,1]]\n", "no LIDAR return falls on the image"),
        ("pairs = 5\n", "not a registration"),
        (
            "".join(f"[[pairs]]\nlidar = [{n}, {n}]\nimage = [{n}, {n}]\n" for n in range(4)),
            "the points lie on one line",
        ),
        (pairs_of((10, 10), (500, 10), (10, 500), (10, 500)), "two pairs share a point"),
        (pairs_of((math.nan, 3), (500, 10), (10, 500), (500, 500)), "a finite number"),
        (
            "matrix = [[1,0,0],[0,1,0],[0,0,1]]\n"
            + pairs_of((10, 10), (500, 10), (10, 500), (500, 500)),
            "a matrix and pairs",
        ),
    ):
        registration.write_text(content)
        dfdbench.refused(told, *build)
