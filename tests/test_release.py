"""What a release rests on: its tag, the versions that the files name, the changelog's notes."""

import runpy
from pathlib import Path

SCRIPT = runpy.run_path(str(Path(__file__).parents[1] / ".github/release_notes.py"))


def test_the_versions_agree_today_and_have_notes() -> None:
    assert not set(SCRIPT["problems_of"]("v0.1.0")) - set(SCRIPT["repository_problems"]())
    assert SCRIPT["notes_of"]("0.1.0").startswith("### Added")
