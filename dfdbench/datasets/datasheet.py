"""What a datasheet says of a data set beyond its manifest: limits, biases, people, uses."""

from __future__ import annotations

import tomllib
from datetime import date
from importlib import resources

from dfdbench.datasets.catalog import released_manifests
from dfdbench.datasets.manifest import Manifest
from dfdbench.system.strict import StrictRecord


class Datasheet(StrictRecord):
    """A data set's facts and judgements that no program can find out.

    `published` is the day of the manifest's first release; `synthetic` whether any image was made,
    not captured; `derived_from` where its files come from, `generated_by` how it was made of them.
    The rest are texts for people, as the Responsible-AI part of Croissant asks for them.
    """

    published: date
    synthetic: bool
    derived_from: list[str]
    generated_by: str
    limitations: str
    biases: str
    personal: str
    use_cases: str
    social_impact: str


def datasheets() -> dict[str, Datasheet]:
    """Return the datasheets that travel with the package, by short name.

    Examples
    --------
    >>> datasheets()["demo"].synthetic
    True
    """
    text = resources.files("dfdbench.datasets").joinpath("datasheets.toml").read_text("utf-8")
    return {name: Datasheet.model_validate(sheet) for name, sheet in tomllib.loads(text).items()}


def datasheet_of(manifest: Manifest) -> Datasheet | None:
    """Return a data set's datasheet, on a track that of the set; None for one of one's own."""
    released = {known.sha256: known.short for known in released_manifests()}
    short = released.get(manifest.sha256)
    return datasheets()[short] if short else None
