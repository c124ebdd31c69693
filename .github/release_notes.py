"""Print what the changelog says of a release; refuse a tag that the project's files do not bear.

python .github/release_notes.py v0.1.0
"""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def problems_of(tag: str, root: Path = ROOT) -> list[str]:
    """Return why no release of this tag can be made from a checkout; empty where one can."""
    version = tag.removeprefix("v")
    found = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]["version"]
    cited = re.search(r"^version: (.+)$", (root / "CITATION.cff").read_text("utf-8"), re.M)
    problems = []
    if not re.fullmatch(r"v\d+\.\d+\.\d+", tag):
        problems.append(f"the tag: expected as v1.2.3, got {tag}")
    if found != version:
        problems.append(f"pyproject.toml: expected version {version}, got {found}")
    if not cited or cited[1] != version:
        problems.append(f"CITATION.cff: expected version {version}, got {cited and cited[1]}")
    if not notes_of(version, root):
        problems.append(f"CHANGELOG.md: expected a section [{version}] that says something")
    return problems + repository_problems(root)


def repository_problems(root: Path = ROOT) -> list[str]:
    """Return where the repository's address is missing or differs from pyproject.toml."""
    urls = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]["urls"]
    if not urls.get("Repository"):
        return ["pyproject.toml: expected the repository's address under [project.urls], got none"]
    address = urls["Repository"]
    lines = {"CITATION.cff": f'repository-code: "{address}"', "README.md": f"git clone {address}"}
    return [
        f"{name}: expected the line {line}"
        for name, line in lines.items()
        if line not in (root / name).read_text("utf-8").splitlines()
    ]


def notes_of(version: str, root: Path = ROOT) -> str:
    """Return the changelog's section of a version, without its heading; empty where none is."""
    text = (root / "CHANGELOG.md").read_text("utf-8")
    found = re.search(rf"^## \[{re.escape(version)}\][^\n]*\n(.*?)(?=^## \[|\Z)", text, re.M | re.S)
    return found[1].strip() if found else ""


def main() -> int:
    """Print the notes of the tag that is named; status 1 where there can be no release."""
    if len(sys.argv) != 2:
        print("expected a tag, as: python .github/release_notes.py v0.1.0", file=sys.stderr)
        return 2
    problems = problems_of(sys.argv[1])
    if problems:
        print("no release of this tag:", *problems, sep="\n  ", file=sys.stderr)
        return 1
    print(notes_of(sys.argv[1].removeprefix("v")))
    return 0


if __name__ == "__main__":
    sys.exit(main())
