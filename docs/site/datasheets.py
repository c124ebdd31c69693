"""A page a data set: of its manifest, of what that does not say, and of what was measured."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from dfdbench.blur.tracks import CLEAN
from dfdbench.board.board import Board
from dfdbench.board.ranking import ScoreBoard
from dfdbench.board.row_file import known_fingerprints
from dfdbench.datasets.catalog import part_name, released_manifests
from dfdbench.datasets.croissant import Datasheet, datasheet_of
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.rendered import FAMILIES, seeded
from dfdbench.metrics.metric import find_metric
from dfdbench.metrics.protocol import title_of
from dfdbench.results.wording import NOTHING, score_text
from dfdbench.tables.render import as_markdown, escape_markdown
from dfdbench.tables.table import Link, Table

PICTURES = Path(__file__).parents[1] / "assets/pictures/datasets"
INDEX = """---
description: Every data set with its size, what its images are, its licence and its page.
---

# All data sets

A page each, of the manifest that builds it. `dfdbench info NAME` shows the rest: scenes, axes,
exclusions with their reasons. Each is described in Croissant 1.1 too, the JSON-LD that search
engines and conferences read: `dfdbench info NAME --croissant`.

| name | what | scenes | pairs | images | licence (license) |
|:---|:---|---:|---:|:---|:---|
"""
#: Sets that share a picture: the first photograph is the same.
_DRAWN = {"unseen-stack": "unseen"}
_VIEWS = "in-focus image, defocus image and depth, bright is near"


def newest_manifests() -> list[Manifest]:
    """Return the newest manifest of each data set."""
    return list({manifest.short: manifest for manifest in released_manifests()}.values())


def dataset_pages(board: Board) -> Iterator[tuple[str, str]]:
    """Yield a page for each data set and their index, each with its place on the site."""
    manifests = newest_manifests()
    listing = "\n".join(
        f"| [`{m.short}`]({m.short}.md) | {escape_markdown(m.title)} | {m.scene_count} "
        f"| {m.pair_count} | {_images(m)} | {escape_markdown(_licence(m))} |"
        for m in manifests
    )
    yield "datasets/index.md", f"{INDEX}{listing}\n"
    for manifest in manifests:
        yield f"datasets/{manifest.short}.md", _page(manifest, board)


def _images(manifest: Manifest) -> str:
    if manifest.simulated:
        return "SIMULATED captures"
    if manifest.short in FAMILIES:
        return "rendered through a thin lens"
    return "synthetic defocus" if manifest.recipe else "captured"


def _licence(manifest: Manifest) -> str:
    return "; ".join(dict.fromkeys(source.licence for source in manifest.sources))


def _page(manifest: Manifest, board: Board) -> str:
    sheet = datasheet_of(manifest)
    assert sheet
    cited = dict.fromkeys(text for source in manifest.sources for text in source.citations)
    splits = ", ".join(
        f"{split.name} ({len(split.scenes)} scenes, {split.pairs} pairs)"
        for split in manifest.splits
    )
    sources = ", ".join(f"[{address.split('/')[2]}]({address})" for address in sheet.derived_from)
    croissant = f"[{manifest.stem}.croissant.json](../files/{manifest.stem}.croissant.json)"
    facts = {
        "images": _images(manifest),
        "scenes, pairs": f"{manifest.scene_count}, {manifest.pair_count}",
        "splits": escape_markdown(splits) or "none; folds and single scenes",
        "depth": escape_markdown(manifest.depth.text),
        "source": sources,
        "licence (license)": escape_markdown(_licence(manifest)),
        "cite": escape_markdown("; ".join(cited)),
        "fingerprint": _fingerprint(manifest, board),
        "manifest": f"{manifest.stem}, of {sheet.published}, SHA-256 `{manifest.sha256[:16]}…`",
        "Croissant": croissant,
    }
    rows = "".join(f"| {name} | {text} |\n" for name, text in facts.items())
    title = json.dumps(f"{manifest.title}: pictures, licence, citation, fingerprint, results.")
    return (
        f"---\ndescription: {title}\n---\n\n# {manifest.short}\n\n"
        f"**{escape_markdown(manifest.title)}.**\n\n{escape_markdown(manifest.description.strip())}\n"
        f"{_picture(manifest)}\n| | |\n|:---|:---|\n{rows}\n"
        f"```\ndfdbench build {_built_by(manifest)}\ndfdbench info {manifest.short}\n```\n"
        + _measured(manifest)
        + _results(manifest, board)
        + _sheet(sheet)
    )


def _built_by(manifest: Manifest) -> str:
    if manifest.short in FAMILIES:
        return f"{manifest.short} --seed 7"
    needs_files = not (manifest.recipe or manifest.simulated)
    return manifest.short + " --source DIR" * needs_files


def _picture(manifest: Manifest) -> str:
    name = _DRAWN.get(manifest.short, manifest.short)
    if not (PICTURES / f"{name}.jpg").exists():
        return "\n*No picture here: the images are not ours to pass on.*\n"
    return (
        f'\n<div class="wide" markdown>\n\n![{name}: {_VIEWS}]'
        f"(../assets/pictures/datasets/{name}.jpg)\n\n</div>\n\n"
        f"*{_VIEWS.capitalize()}; drawn by `python docs/site/pictures.py datasets`.*\n"
    )


def _fingerprint(manifest: Manifest, board: Board) -> str:
    if known := known_fingerprints(board.folder).get(manifest.stem):
        return " or ".join(f"`{each}`" for each in known)
    if manifest.short in FAMILIES:
        return "one a seed: see its rankings"
    return f"none recorded here; `dfdbench info {manifest.short}` shows that of your store"


def _measured(manifest: Manifest) -> str:
    """Return what audits say of the set, as `pictures.py measured` kept it."""
    found = json.loads((PICTURES / "measured.json").read_text("utf-8")).get(manifest.short)
    if not found:
        return ""
    said = [
        f"{_percent(found['uncovered'])} of the test's known pixels lie on depth levels that "
        f"training lacks or hardly shows (`dfdbench audit coverage {manifest.short}`)"
    ]
    if "neighbours" in found:
        said.append(
            f"{_percent(found['neighbours'])} of the test's pixels would look the same one level "
            f"nearer or farther, {_percent(found['coarse'])} even 32 levels "
            f"(`dfdbench audit difficulty {manifest.short}`)"
        )
    picture = (
        f"![{manifest.short}: how often each depth occurs]"
        f"(../assets/pictures/datasets/{manifest.short}-depths.jpg){{ .plot }}\n"
    )
    listing = "".join(f"- {text}.\n" for text in said)
    return f"\n## What was measured of it\n\n{listing}\n{picture}"


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _results(manifest: Manifest, board: Board) -> str:
    rows = [
        row for one in board.boards if one.headline and (row := _row(one, manifest)) is not None
    ]
    if not rows:
        return "\n## Results\n\nNo method has a row on it yet.\n"
    columns = ("ranking", "protocol", "rows", "best", "score", "`constant`")
    table = Table("", columns, tuple(rows), "llrlrr")
    text = as_markdown(table).partition("\n\n")[2].replace("\\`", "`")
    return (
        "\n## Results\n\nThe best of each ranking, whatever it was given; "
        f"[the board](../board/index.md) says what.\n\n{text}"
    )


def _row(board: ScoreBoard, manifest: Manifest) -> tuple[str, ...] | None:
    data = board.result.dataset
    base, _ = part_name(data.short)
    family = seeded(base)
    if (family[0] if family else base) != manifest.short:
        return None
    first = board.standings[0]
    constant = next((s for s in board.standings if s.entry.label == "constant"), None)
    suite = "" if board.suite == CLEAN else f", {board.suite}"
    heading = find_metric(board.metric).heading
    page = f"../board/{part_name(data.name)[0]}-{data.split}.md"
    return (
        Link(f"{data.label}, {data.split}{suite}", page),
        f"{title_of(board.protocol)}, {heading}",
        str(len(board.standings)),
        first.entry.label,
        score_text(first.scores[board.metric]),
        score_text(constant.scores[board.metric]) if constant else NOTHING,
    )


def _sheet(sheet: Datasheet) -> str:
    facts = {
        "how it was made": sheet.generated_by,
        "limits": sheet.limitations,
        "biases": sheet.biases,
        "people": sheet.personal,
        "what it is for": sheet.use_cases,
        "what it may do": sheet.social_impact,
    }
    rows = "".join(f"| {name} | {escape_markdown(text)} |\n" for name, text in facts.items())
    return f"\n## Datasheet\n\n| | |\n|:---|:---|\n{rows}"
