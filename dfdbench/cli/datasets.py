"""The verbs for data sets: list, info, build."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from dfdbench.blur import RECIPES
from dfdbench.build import BuildReport, build_store
from dfdbench.catalog import find_manifest, released_manifests
from dfdbench.cli.screen import print_table, progress, say
from dfdbench.errors import InputError, Problem
from dfdbench.manifest import Manifest
from dfdbench.methods import registered_methods
from dfdbench.sources import open_source
from dfdbench.store import default_store
from dfdbench.tables import Table


def list_datasets() -> None:
    """List the data sets and the registered methods."""
    rows = tuple(
        (
            manifest.short, manifest.stem, str(manifest.scene_count), str(manifest.pair_count),
            "yes" if default_store(manifest).exists() else "no", manifest.title,
        )
        for manifest in released_manifests()
    )  # fmt: skip
    print_table(
        Table("data sets", ("name", "manifest", "scenes", "pairs", "built", ""), rows, "llrrll")
    )
    methods = tuple(sorted(registered_methods().items()))
    print_table(Table("methods", ("name", "entry"), methods, "ll"))


def info(
    name: Annotated[str, typer.Argument(help="A data set's name or a manifest's path.")],
    pairs: Annotated[
        str | None, typer.Option(help="List the pairs of this split, fold or scene, one a line.")
    ] = None,
) -> None:
    """Show what a data set consists of."""
    manifest = find_manifest(name)
    if pairs is not None:
        for pair in manifest.pairs(pairs):
            print(pair.id)
        return
    _show_manifest(manifest)


def build(
    name: Annotated[str, typer.Argument(help="A data set's name or a manifest's path.")],
    source: Annotated[
        Path | None, typer.Option(help="Folder with the files, in the site's layout.")
    ] = None,
    store: Annotated[Path | None, typer.Option(help="Where to build; default: the cache.")] = None,
    recipe: Annotated[str | None, typer.Option(help=f"Blur recipe: {', '.join(RECIPES)}.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Scenes made at once.")] = os.cpu_count() or 1,
    default_lighting: Annotated[
        bool,
        typer.Option("--default-lighting", help="Take SCENE/view1.png for Illum1/Exp2."),
    ] = False,
    pair: Annotated[
        str | None,
        typer.Option(help="In-focus and defocus voltage step of captured pairs: 141,129."),
    ] = None,
    allow_missing: Annotated[
        bool, typer.Option("--allow-missing", help="Succeed although pairs are missing.")
    ] = False,
) -> None:
    """Build a data set; what is finished already is kept."""
    manifest = find_manifest(name)
    place = store or default_store(manifest)
    if recipe not in (None, manifest.recipe) and store is None:
        raise InputError(
            Problem(
                "another blur recipe makes another data set", "--recipe", str(manifest.recipe),
                str(recipe), "name its place: --store PATH",
            )
        )  # fmt: skip
    steps = _voltage_steps(manifest, pair, store)
    files = open_source(manifest, source, default_lighting, steps)
    with progress("building scenes") as step:
        report = build_store(manifest, files, place, recipe, workers, step)
    kept = f", {len(report.scenes_kept)} kept from before" if report.scenes_kept else ""
    print(f"built {manifest.stem}: {report.pairs} pairs, {len(report.scenes_built)} scenes{kept}")
    print(f"store        {report.path}")
    print(f"fingerprint  {report.fingerprint}")
    if report.missing:
        say(_missing_text(manifest, report, files.missing_help(report.missing)))
        if not allow_missing:
            raise typer.Exit(2)


def _voltage_steps(
    manifest: Manifest, pair: str | None, store: Path | None
) -> tuple[int, int] | None:
    if pair is None:
        return None
    try:
        infocus, defocus = (int(step) for step in pair.split(","))
    except ValueError:
        raise InputError(
            Problem("not a pair of voltage steps", "--pair", "two steps, as 141,129", pair)
        ) from None
    usual = manifest.capture and (manifest.capture.infocus_step, manifest.capture.defocus_step)
    if usual not in (None, (infocus, defocus)) and store is None:
        raise InputError(
            Problem(
                "another pair of voltage steps makes another data set", "--pair", f"{usual}", pair,
                "name its place: --store PATH",
            )
        )  # fmt: skip
    return infocus, defocus


def _show_manifest(manifest: Manifest) -> None:
    lines = [
        f"{manifest.title}",
        f"  manifest   {manifest.stem}  sha256 {manifest.sha256}",
        f"  scenes     {manifest.scene_count}",
        f"  pairs      {manifest.pair_count}",
        f"  recipe     {manifest.recipe or 'none: both images are captured'}",
    ]
    lines += [
        f"  axis       {axis}: {', '.join(map(str, values))}"
        for axis, values in manifest.axes.items()
    ]
    lines += [
        f"  split      {split.name} ({split.partition}): {split.pairs} pairs of "
        f"{len(split.scenes)} scenes"
        + (f": {', '.join(split.scenes)}" if len(split.scenes) <= 8 else "")
        for split in manifest.splits
    ]
    lines += [f"  fold       {fold.name}: {', '.join(fold.test_scenes)}" for fold in manifest.folds]
    for exclusion in manifest.exclusions:
        where = "; ".join(f"{axis} {values}" for axis, values in exclusion.coordinates.items())
        lines.append(
            f"  left out   {exclusion.pairs} pairs of {', '.join(exclusion.scenes)}, {where}: "
            f"{exclusion.reason}"
        )
    for source in manifest.sources:
        lines.append(f"  source     {source.name}: {source.url}")
        lines.append(f"  licence    {source.licence}")
    citations = dict.fromkeys(cite for source in manifest.sources for cite in source.citations)
    lines += [f"  cite       {citation}" for citation in citations]
    place = default_store(manifest)
    lines.append(f"  store      {place} ({'built' if place.exists() else 'not built'})")
    print("\n".join(lines))


def _missing_text(manifest: Manifest, report: BuildReport, fix: str) -> str:
    by_scene: dict[str, list[str]] = {}
    for pair in report.missing:
        by_scene.setdefault(pair.scene, []).append(pair.id.partition("/")[2])
    whole = [s for s in by_scene if len(by_scene[s]) == len(manifest.pairs_of_scene(s))]
    lines = [
        f"missing: {len(report.missing)} of {manifest.pair_count} pairs, left out of the store"
    ]
    if whole:
        lines.append(f"  no image at all   {', '.join(whole)}")
    alike: dict[str, list[str]] = {}
    for scene, places in by_scene.items():
        if scene not in whole:
            alike.setdefault(", ".join(places), []).append(scene)
    for listed, scenes in alike.items():
        lines.append(f"  {', '.join(scenes)}: {listed.count(',') + 1} pairs each")
        lines.append(f"    {listed}")
    lines.append(f"  fix               {fix}")
    return "\n".join(lines)
