"""A data set's description in Croissant 1.1, JSON-LD that search engines and conferences read."""

import json
import tomllib
from datetime import date
from importlib import resources
from typing import Any

from pydantic import Field

from dfdbench.blur.tracks import find_degradation
from dfdbench.datasets.catalog import released_manifests
from dfdbench.datasets.manifest import Manifest
from dfdbench.system.strict import StrictRecord


class Datasheet(StrictRecord):
    """A data set's facts and judgements that no program can find out.

    `published` is the day of the manifest's first release. `synthetic` says whether any image was
    made rather than captured, `derived_from` where its files come from, and `generated_by` how the
    set was made from them. The rest are texts for people, as the Responsible-AI part of Croissant
    asks for them.
    """

    published: date = Field(serialization_alias="datePublished")
    limitations: str = Field(serialization_alias="rai:dataLimitations")
    biases: str = Field(serialization_alias="rai:dataBiases")
    personal: str = Field(serialization_alias="rai:personalSensitiveInformation")
    use_cases: str = Field(serialization_alias="rai:dataUseCases")
    social_impact: str = Field(serialization_alias="rai:dataSocialImpact")
    synthetic: bool = Field(serialization_alias="rai:hasSyntheticData")
    derived_from: list[str]
    generated_by: str


def datasheets() -> dict[str, Datasheet]:
    """Return the datasheets that the package ships, by short name.

    Examples
    --------
    >>> datasheets()["demo"].synthetic
    True
    """
    text = resources.files("dfdbench.datasets").joinpath("datasheets.toml").read_text("utf-8")
    return {name: Datasheet.model_validate(sheet) for name, sheet in tomllib.loads(text).items()}


def datasheet_of(manifest: Manifest) -> Datasheet | None:
    """Return a released data set's datasheet (its tracks share it), or None."""
    released = {known.sha256: known.short for known in released_manifests()}
    short = released.get(manifest.written_sha256)
    return datasheets()[short] if short else None


CROISSANT = "http://mlcommons.org/croissant/1.1"
RESPONSIBLE_AI = "http://mlcommons.org/croissant/RAI/1.0"
#: The context from the specification, and the vocabulary for the origin of data.
CONTEXT: dict[str, Any] = json.loads(
    resources.files("dfdbench.datasets").joinpath("croissant.json").read_text("utf-8")
)
_PAIRS = "pairs"


def croissant_text(manifest: Manifest) -> str:
    """Return the description as the text of a JSON-LD file."""
    return json.dumps(croissant_of(manifest), indent=1, ensure_ascii=False) + "\n"


def croissant_of(manifest: Manifest) -> dict[str, Any]:
    """Return a data set's description in Croissant 1.1.

    Its one file is the manifest, which says where the images come from; `dfdbench build` makes the
    store from it. Its one record set lists the pairs. A released set also has the Responsible-AI
    fields, from its datasheet; your own set has what its manifest says.

    Parameters
    ----------
    manifest : Manifest
        The data set, on a track or not.

    References
    ----------
    Croissant Format Specification 1.1, Croissant RAI Specification 1.0, MLCommons.
    """
    sheet = datasheet_of(manifest)
    description = manifest.description.strip()
    if manifest.on_track:
        description += f" On the track {find_degradation(manifest.degradation).text}."
    cited = [text for source in manifest.sources for text in source.citations]
    content: dict[str, Any] = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": [CROISSANT, RESPONSIBLE_AI] if sheet else CROISSANT,
        "name": manifest.stem,
        "alternateName": manifest.title,
        "description": description,
        "url": manifest.sources[0].url,
        "version": f"{manifest.version}.0.0",
        "license": list(dict.fromkeys(source.licence for source in manifest.sources)),
        "creator": {"@type": "sc:Organization", "name": "The dfdbench authors"},
        "citeAs": "; ".join(dict.fromkeys(cited)),
        "keywords": ["depth from defocus", "depth estimation", "benchmark"],
        "isLiveDataset": False,
        "distribution": [_file(manifest)],
        # If scenes are to be found, they are unknown before the set is built.
        **({"recordSet": [_records(manifest)]} if manifest.scenes else {}),
    }
    return content | (_responsible(sheet) if sheet else {})


def _responsible(sheet: Datasheet) -> dict[str, Any]:
    own = {"derived_from", "generated_by"}
    building = {"@type": "prov:Activity", "prov:label": "dfdbench build"}
    return sheet.model_dump(mode="json", by_alias=True, exclude=own) | {
        "prov:wasDerivedFrom": [{"@id": address} for address in sheet.derived_from],
        "prov:wasGeneratedBy": {**building, "description": sheet.generated_by},
    }


def _file(manifest: Manifest) -> dict[str, Any]:
    name = f"{manifest.file_stem}.toml"
    return {
        "@type": "cr:FileObject",
        "@id": name,
        "name": name,
        "description": "The manifest: sources, scenes, splits, exclusions, checksums.",
        "contentUrl": name,
        "encodingFormat": "application/toml",
        "sha256": manifest.sha256,
    }


def _records(manifest: Manifest) -> dict[str, Any]:
    what = {
        "id": ("sc:Text", "The pair's name."),
        "scene": ("sc:Text", "The scene that it shows."),
        **dict.fromkeys(manifest.axes, ("sc:Integer", "Its value on this axis.")),
    }
    rows = [{"id": pair.id, "scene": pair.scene, **pair.at} for pair in manifest.pairs()]
    return {
        "@type": "cr:RecordSet",
        "@id": _PAIRS,
        "name": _PAIRS,
        "description": "The pairs: an in-focus image, a defocus image, a depth map each.",
        "key": {"@id": f"{_PAIRS}/id"},
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"{_PAIRS}/{name}",
                "name": name,
                "description": text,
                "dataType": kind,
            }
            for name, (kind, text) in what.items()
        ],
        "data": [{f"{_PAIRS}/{name}": row[name] for name in row} for row in rows],
    }
