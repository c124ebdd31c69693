"""What a release rests on: its tag, the versions that the files name, the changelog's notes."""

import runpy
import shutil
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
ADDRESS = "https://example.org/dfdbench"


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """The files that a release looks at, as they are when 0.1.0 is to be released."""
    for name in ("pyproject.toml", "CITATION.cff", "CHANGELOG.md", "README.md"):
        shutil.copy(ROOT / name, tmp_path / name)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    if not project["urls"]:
        fill(tmp_path / "pyproject.toml", "[project.urls]", f'Repository = "{ADDRESS}"')
        fill(tmp_path / "CITATION.cff", "license: MIT", f'repository-code: "{ADDRESS}"')
        fill(tmp_path / "README.md", "## Two commands", f"git clone {ADDRESS}")
    changes = tmp_path / "CHANGELOG.md"
    text = changes.read_text("utf-8")
    changes.write_text(f"{text}\n## [0.0.1] - 2026-01-01\n\nThe first.\n", "utf-8")
    return tmp_path


def fill(path: Path, after: str, line: str) -> None:
    path.write_text(path.read_text("utf-8").replace(after, f"{after}\n{line}", 1), "utf-8")


SCRIPT = runpy.run_path(str(ROOT / ".github/release_notes.py"))


def test_a_tag_that_all_files_bear_gets_the_changelogs_notes(checkout: Path) -> None:
    assert SCRIPT["problems_of"]("v0.1.0", checkout) == []
    notes = SCRIPT["notes_of"]("0.1.0", checkout)
    assert notes.startswith("### Added")
    assert "The first." not in notes
    assert SCRIPT["notes_of"]("0.0.1", checkout) == "The first."


def test_what_a_tag_lacks_is_told_together(checkout: Path) -> None:
    found = SCRIPT["problems_of"]("v0.2.0", checkout)
    named = [text.partition(":")[0] for text in found]
    assert named == ["pyproject.toml", "CITATION.cff", "CHANGELOG.md"]
    assert SCRIPT["problems_of"]("0.1", checkout)[0] == "the tag: expected as v1.2.3, got 0.1"


def test_the_versions_agree_today() -> None:
    found = set(SCRIPT["problems_of"]("v0.1.0")) - set(SCRIPT["repository_problems"]())
    assert not found
