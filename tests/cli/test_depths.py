from pathlib import Path

from tests.cli.command import Command


def test_depths_are_counted_and_drawn(dfdbench: Command, uneven: str) -> None:
    whole = dfdbench("depths", uneven, "--format", "csv", "--figure", "figures/depths.png")
    lines = whole.out.splitlines()
    assert lines[0] == "level,pixels,share"
    assert len(lines) == 257
    # Three: 3 pairs of 4 rows of 32 pixels, of which 11 columns are 36.
    assert lines[37].split(",")[:2] == ["36", str(3 * 4 * 11)]
    assert Path("figures/depths.png").stat().st_size > 10_000
    scene = dfdbench("depths", uneven, "--split", "One", "--format", "markdown")
    assert "| 96-111 | 2,760 | 100.0 % | 96-99, 101-111 |" in scene.out
    assert "| 32-47 | 0 | 0 % | all |" in scene.out
    wrong = dfdbench("depths", uneven, "--split", "Ome")
    assert wrong.status == 2
    assert "did you mean One" in wrong.err
