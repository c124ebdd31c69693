import re
from pathlib import Path

import cv2
import pytest

from dfdbench.report.markdown import write_markdown
from dfdbench.results.saved_run import SavedRun


@pytest.mark.slow
def test_it_says_the_same_with_pictures_beside_it(
    saved_runs: list[SavedRun], tmp_path: Path
) -> None:
    text = write_markdown(saved_runs, "thesis", tmp_path).read_text("utf-8")
    pictures = re.findall(r"^!\[.*\]\((.*?)\)$", text, re.M)
    # An illumination each, the times, accuracy against them, and each method's worst pairs.
    assert len(pictures) == 7
    for name in pictures:
        assert cv2.imread(str(tmp_path / name)) is not None
    assert "<img" not in text
    assert "constant" in text
    assert text.count("**best and worst pairs, protocol thesis**") == 2
