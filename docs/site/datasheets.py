"""A datasheet page a data set, of its manifest and of what the manifest does not say."""

from __future__ import annotations

from dfdbench.datasets.catalog import released_manifests
from dfdbench.datasets.croissant import datasheet_of
from dfdbench.datasets.manifest import Manifest
from dfdbench.tables.render import escape_markdown

HEAD = """# Data sets

One sheet a data set, of the manifest that builds it. `dfdbench info NAME` shows the rest: scenes,
axes, exclusions with their reasons. Each sheet is there in Croissant 1.1 too, the JSON-LD that
search engines and conferences read: `dfdbench info NAME --croissant`.

| name | what | scenes | pairs | images |
|:---|:---|---:|---:|:---|
"""


def newest_manifests() -> list[Manifest]:
    """Return the newest manifest of each data set."""
    return list({manifest.short: manifest for manifest in released_manifests()}.values())


def datasheets_page() -> str:
    """Return the page: a table of all sets, and a section each."""
    manifests = newest_manifests()
    listed = "\n".join(
        f"| [`{m.short}`](#{m.short}) | {escape_markdown(m.title)} | {m.scene_count} "
        f"| {m.pair_count} | {_images(m)} |"
        for m in manifests
    )
    return HEAD + listed + "\n" + "".join(map(_sheet, manifests))


def _images(manifest: Manifest) -> str:
    if manifest.simulated:
        return "SIMULATED captures"
    return "synthetic defocus" if manifest.recipe else "captured"


def _sheet(manifest: Manifest) -> str:
    sheet = datasheet_of(manifest)
    assert sheet
    splits = ", ".join(
        f"{split.name} ({len(split.scenes)} scenes, {split.pairs} pairs)"
        for split in manifest.splits
    )
    cited = dict.fromkeys(text for source in manifest.sources for text in source.citations)
    licences = dict.fromkeys(source.licence for source in manifest.sources)
    facts = {
        "manifest": f"{manifest.stem}, of {sheet.published}, SHA-256 {manifest.sha256[:16]}...",
        "splits": splits or "none; folds and single scenes",
        "depth": f"brighter is {manifest.depth.direction}; {manifest.depth.unit}",
        "how it was made": sheet.generated_by,
        "limits": sheet.limitations,
        "biases": sheet.biases,
        "people": sheet.personal,
        "what it is for": sheet.use_cases,
        "what it may do": sheet.social_impact,
        "licence": "; ".join(licences),
        "cite": "; ".join(cited),
    }
    rows = "".join(f"| {name} | {escape_markdown(text)} |\n" for name, text in facts.items())
    sources = ", ".join(f"[{address.split('/')[2]}]({address})" for address in sheet.derived_from)
    croissant = f"[{manifest.stem}.croissant.json](../files/{manifest.stem}.croissant.json)"
    return (
        f"\n## {manifest.short}\n\n{escape_markdown(manifest.description.strip())}\n\n"
        f"| | |\n|:---|:---|\n{rows}| made of | {sources} |\n| Croissant | {croissant} |\n"
    )
