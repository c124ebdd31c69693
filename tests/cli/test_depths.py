from pathlib import Path

import pytest

from tests.cli.command import Command


def test_depths_are_counted_and_drawn(dfdbench: Command, uneven: str) -> None:
    whole = dfdbench("audit", "depths", uneven, "--format", "csv", "--figure", "figures/depths.png")
    lines = whole.out.splitlines()
    assert lines[0] == "level,pixels,share"
    assert len(lines) == 257
    # Three: 3 pairs of 4 rows of 32 pixels, of which 11 columns are 36.
    assert lines[37].split(",")[:2] == ["36", str(3 * 4 * 11)]
    assert Path("figures/depths.png").stat().st_size > 10_000
    scene = dfdbench("audit", "depths", uneven, "--split", "One", "--format", "markdown")
    assert "| 96-111 | 2,760 | 100.0 % | 96-99, 101-111 |" in scene.out
    assert "| 32-47 | 0 | 0 % | all |" in scene.out
    wrong = dfdbench("audit", "depths", uneven, "--split", "Ome")
    assert wrong.status == 2
    assert "did you mean One" in wrong.err


@pytest.mark.slow
def test_errors_by_depth_stand_beside_a_constants(dfdbench: Command, uneven: str) -> None:
    for level in ("90", "40"):
        ran = dfdbench(
            *("run", "--dataset", uneven, "--split", "all", "--method", "constant"),
            *("--param", f"training_mean={level}", "--out", f"runs/{level}"),
        )
        assert ran.status == 0, ran.err
    one = dfdbench("audit", "depths", uneven, "--result", "runs/90", "--figure", "errors.png")
    assert one.status == 0, one.err
    assert "mean absolute error by depth" in one.out
    assert "constant (training_mean=90)" in one.out
    assert Path("errors.png").stat().st_size > 10_000
    both = dfdbench(
        *("audit", "depths", uneven, "--result", "runs/90", "--result", "runs/40/result.json"),
        *("--format", "csv"),
    )
    heading, *rows = both.out.splitlines()
    assert heading.startswith("levels,of all,constant (training_mean=90),")
    # 11 columns of 36, 11 of 37 and 10 of 38 are answered with 90, and with 40.
    (near,) = [row.split(",") for row in rows if row.startswith("36-38,")]
    assert near[2:4] == ["53.03", "3.03"]
    wrong = dfdbench("audit", "depths", uneven, "--split", "all", "--result", "runs/90")
    assert wrong.status == 2
    assert "a run says itself which split" in wrong.err
