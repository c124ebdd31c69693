"""What MkDocs cannot know: pages made from code, and files of the repository beside `docs/`."""

from __future__ import annotations

import json
import posixpath
import re
import sys
import tomllib
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from dfdbench.board.board import leaderboard
from dfdbench.datasets.croissant import croissant_text

sys.path.insert(0, str(Path(__file__).parent))
from board import board_page
from commands import commands_page
from datasheets import datasheets_page, newest_manifests
from formats import formats_page

ROOT = Path(__file__).parents[2]
#: Pages that are files of the repository, or parts of them, by where the site has them.
COPIED = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md"}
#: The leaderboard's README and, in its place on the site, all of its tables.
BOARD, TABLES = "leaderboard/README.md", "board/tables.md"
SCHEMAS = ROOT / "dfdbench/results/schemas"
#: Sections of CONTRIBUTING.md that are a page of their own.
SUBMITTING = ("Submit a result", "Review a submission")
_LINK = re.compile(r"(?<=\]\()([^)#:\s]*)(#[^)\s]*)?(?=\))")


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Link to the repository from every page, if pyproject.toml has its address."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["urls"]
    if address := urls.get("Repository"):
        config.repo_url = address
        config.repo_name = urlsplit(address).path.strip("/")
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made from the code, and the files that pages link to."""

    def add(place: str, content: str) -> None:
        files.append(File.generated(config, place, content=content))

    add("reference/commands.md", commands_page())
    add("reference/formats.md", formats_page())
    add("reference/datasets.md", datasheets_page())
    for manifest in newest_manifests():
        add(f"files/{manifest.stem}.croissant.json", croissant_text(manifest))
    add("board/index.md", board_page(ROOT / "leaderboard"))
    add(TABLES, _relinked(leaderboard(ROOT / "leaderboard").page(), BOARD, TABLES))
    add("submit.md", _relinked(_submitting(), "CONTRIBUTING.md", "submit.md"))
    for name, place in COPIED.items():
        add(place, _relinked((ROOT / name).read_text("utf-8"), name, place))
    for path in sorted((ROOT / "leaderboard/results").rglob("*.json")):
        inside = path.relative_to(ROOT / "leaderboard").as_posix()
        files.append(File.generated(config, f"board/{inside}", abs_src_path=str(path)))
    for path in sorted(SCHEMAS.glob("*.json")):
        files.append(File.generated(config, f"files/{path.name}", abs_src_path=str(path)))
    for path in sorted((ROOT / "docs/notebooks").glob("*.ipynb")):
        add(f"notebooks/{path.stem}.md", _notebook(path))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead links that leave `docs/` to the pages that stand for those files here."""
    place = page.file.src_uri
    made = place in {*COPIED.values(), "submit.md"} or place.startswith(("reference/", "board/"))
    return markdown if made else _relinked(markdown, f"docs/{place}", place)


def _relinked(markdown: str, source: str, place: str) -> str:
    """Return a file's text with its links as they lead from its place on the site."""

    def lead(found: re.Match[str]) -> str:
        target, anchor = found[1], found[2] or ""
        if not target:
            return anchor
        wanted = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        there = _on_site(wanted)
        return posixpath.relpath(there, posixpath.dirname(place) or ".") + anchor

    # GitHub reads Markdown inside HTML as it is; here it has to be asked for.
    return _LINK.sub(lead, markdown).replace("<details>", "<details markdown>")


def _on_site(name: str) -> str:
    if name in COPIED or name == BOARD:
        return COPIED.get(name, TABLES)
    if name.startswith("leaderboard/results/"):
        return name.replace("leaderboard/", "board/", 1)
    return name.removeprefix("docs/")


def _submitting() -> str:
    text = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    sections = dict(re.findall(r"^## (.+?)\n(.*?)(?=^## |\Z)", text, re.S | re.M))
    return f"# {SUBMITTING[0]}\n" + "".join(
        (f"\n## {name}\n" if number else "") + sections[name]
        for number, name in enumerate(SUBMITTING)
    )


def _notebook(path: Path) -> str:
    """Return a notebook as a page: its text, its code, and a link to itself."""
    parts = []
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        text = "".join(cell["source"])
        parts.append(text if cell["cell_type"] == "markdown" else f"```python\n{text}\n```")
    note = (
        f"*This page is a notebook, [{path.name}]({path.name}). To run it, in a clone: "
        f"`pip install . jupyterlab`, then `jupyter lab docs/notebooks/{path.name}`.*"
    )
    title, *rest = parts[0].split("\n", 1)
    return "\n\n".join([title, note, *rest, *parts[1:]]) + "\n"
