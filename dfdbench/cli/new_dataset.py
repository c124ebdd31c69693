"""The verb that begins a data set of one's own: new-dataset."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dfdbench.cli.answer import writing
from dfdbench.errors import InputError
from dfdbench.results.output_place import output_place
from dfdbench.system.files import write_whole


def new_dataset(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Pairs or stacks of photographs, and depth maps.")
    ],
    out: Annotated[
        Path | None, typer.Option(help="The manifest to write; default: NAME-1.toml, here.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(help="The data set's name; default: the folder's.")
    ] = None,
) -> None:
    """Look at a folder of captures and write a manifest for a person to finish."""
    from dfdbench.building.new_manifest import new_manifest

    written = new_manifest(folder, name)
    path = output_place(out or written.name, folder)
    if path.exists():
        raise InputError(
            f"a {'folder' if path.is_dir() else 'file'} of that name is there",
            where=str(path),
            fix="name another: --out FILE.toml",
        )
    with writing(path):
        write_whole(path, written.toml)
    for heading, lines in (("found", written.found), ("say yourself", written.open)):
        print(f"{heading}:")
        for line in lines:
            print(f"  {line}")
    print(f"manifest     {path}")
    print(f"next         dfdbench build {path} --source {folder}")
