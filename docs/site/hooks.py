"""What MkDocs cannot know: pages made from code, and files of the repository beside `docs/`."""

from __future__ import annotations

import json
import re
import sys
import tomllib
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.nav import Navigation

from dfdbench.board.board import leaderboard
from dfdbench.board.cards import load_cards
from dfdbench.datasets.croissant import croissant_text

sys.path.insert(0, str(Path(__file__).parent))
from board import board_files
from cards import method_pages
from commands import commands_page
from datasheets import dataset_pages, newest_manifests
from discovery import description_of, llms_text
from formats import formats_page
from gallery import gallery_page
from links import COPIED, relinked

ROOT = Path(__file__).parents[2]
SCHEMAS = ROOT / "dfdbench/results/schemas"
#: Sections of CONTRIBUTING.md that are a page of their own.
SUBMITTING = ("Submit a result", "Review a submission")
#: Words that people search for and our texts spell otherwise.
LICENCE = """# Licence

The code is under the MIT licence (license) below. Each data set has a licence (license) of its
own: [all data sets](datasets/index.md). A method's is on its page: [all methods](method/index.md).

"""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the addresses of pyproject.toml on every page, and the made pages into the navigation."""
    urls = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["urls"]
    if address := urls.get("Repository"):
        config.repo_url = address
        config.repo_name = urlsplit(address).path.strip("/")
    if address := urls.get("Documentation"):
        config.site_url = f"{address.rstrip('/')}/"
    made = {
        "method/index.md": [f"method/{name}.md" for name in load_cards(ROOT / "leaderboard")],
        "datasets/index.md": [f"datasets/{each.short}.md" for each in newest_manifests()],
    }
    for pages in (each for section in config.nav or [] for each in section.values()):
        for index, members in made.items():
            if isinstance(pages, list) and index in pages:
                pages[pages.index(index) + 1 : pages.index(index) + 1] = members
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that are made from the code, and the files that pages link to."""

    def add(place: str, content: str | bytes) -> None:
        files.append(File.generated(config, place, content=content))

    board = leaderboard(ROOT / "leaderboard")
    for place, content in (*board_files(board), *method_pages(board), *dataset_pages(board)):
        add(place, content)
    add("reference/commands.md", commands_page())
    add("reference/formats.md", formats_page())
    add("gallery.md", gallery_page())
    for manifest in newest_manifests():
        add(f"files/{manifest.stem}.croissant.json", croissant_text(manifest))
    add("submit.md", relinked(_submitting(), "CONTRIBUTING.md", "submit.md"))
    for name, place in COPIED.items():
        text = (ROOT / name).read_text("utf-8")
        add(place, LICENCE + text if name == "LICENSE" else relinked(text, name, place))
    for path in sorted((ROOT / "leaderboard/results").rglob("*.json")):
        inside = path.relative_to(ROOT / "leaderboard").as_posix()
        files.append(File.generated(config, f"board/{inside}", abs_src_path=str(path)))
    for path in sorted(SCHEMAS.glob("*.json")):
        files.append(File.generated(config, f"files/{path.name}", abs_src_path=str(path)))
    for path in sorted((ROOT / "docs/notebooks").glob("*.ipynb")):
        place = f"notebooks/{path.stem}.md"
        add(place, relinked(_notebook(path), f"docs/{place}", place))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Describe a page, and lead links that leave `docs/` to the pages of those files."""
    said = page.meta.get("description") or description_of(markdown)
    # The theme writes it into an attribute as it is.
    page.meta["description"] = re.sub("[<>]", "", said).replace('"', "'")
    place = page.file.src_uri
    return markdown if page.file.generated_by else relinked(markdown, f"docs/{place}", place)


def on_page_context(context: Any, page: Any, config: MkDocsConfig, nav: Navigation) -> None:
    """Write `llms.txt` with the first page: by then every page has its description."""
    if page.is_homepage:
        text = llms_text(config, nav)
        (Path(config.site_dir) / "llms.txt").write_text(text, "utf-8")


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
