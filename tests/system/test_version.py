import tomllib
from pathlib import Path

import dfdbench
from dfdbench.system.version import PACKAGE_VERSION

ROOT = Path(__file__).parents[2]


def test_the_version_is_that_of_the_project_and_of_the_face() -> None:
    assert (
        tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["version"]
        == PACKAGE_VERSION
    )
    assert dfdbench.__version__ == PACKAGE_VERSION


def test_what_to_cite_names_the_version() -> None:
    assert f"\nversion: {PACKAGE_VERSION}\n" in (ROOT / "CITATION.cff").read_text("utf-8")
    assert f"version = {{{PACKAGE_VERSION}}}" in (ROOT / "docs/questions.md").read_text("utf-8")
