"""Read a manifest from TOML and check it whole, so that one problem hides no other."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import TypeAdapter, ValidationError

from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_checks import check_sections
from dfdbench.errors import ManifestError, Problem
from dfdbench.system.files import read_as
from dfdbench.system.strict import problems_of
from dfdbench.system.text import parse_toml


def read_manifest(path: str | Path) -> Manifest:
    """Read a manifest file and check it whole.

    Parameters
    ----------
    path : str or Path
        A TOML file.

    Returns
    -------
    Manifest
        Frozen; its `sha256` is that of the file.

    Raises
    ------
    ManifestError
        With every problem found: file, field, expected, got.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> len(find_manifest("middlebury").pairs("test"))
    54
    """
    return parse_manifest(read_as(ManifestError, Path(path), "the manifest"), Path(path).name)


def parse_manifest(content: bytes, file: str) -> Manifest:
    """Check a manifest's bytes and return it; `file` is the name that problems give.

    Raises
    ------
    ManifestError
        With every problem found: file, field, expected, got.
    """
    try:
        text = content.decode("utf-8")
        raw = parse_toml(text)
    except ValueError as error:
        raise ManifestError("not a TOML file", where=file, got=str(error)) from error
    raw["toml"] = text
    sections, problems = _validate_sections(raw, file)
    problems += check_sections(sections, file)
    ManifestError.raise_if(problems)
    return Manifest.model_construct(None, **sections)


def released_sha256(manifest: Manifest) -> str | None:
    """Return the SHA-256 of the released manifest of this name and version; None if there is none.

    Examples
    --------
    >>> from dfdbench.datasets.catalog import find_manifest
    >>> demo = find_manifest("demo")
    >>> released_sha256(demo) == demo.sha256
    True
    """
    # Not from `released_manifests`: every worker opens stores, and parsing all of them takes long.
    file = resources.files("dfdbench.manifests") / f"{manifest.file_stem}.toml"
    return hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None


def _validate_sections(raw: dict[str, Any], file: str) -> tuple[dict[str, Any], list[Problem]]:
    # Section by section, so that one broken field does not hide what is wrong in the others.
    sections: dict[str, Any] = {}
    problems: list[Problem] = []
    for name, field in Manifest.model_fields.items():
        if name not in raw:
            if field.is_required():
                problems.append(Problem("field is missing", where=f"{file}: {name}"))
            else:
                sections[name] = field.get_default(call_default_factory=True)
            continue
        try:
            sections[name] = _adapter(name).validate_python(raw[name], strict=True)
        except ValidationError as error:
            problems += problems_of(error, "wrong value", file=file, section=name)
    problems += [
        Problem("unknown field", where=f"{file}: {name}")
        for name in raw
        if name not in Manifest.model_fields
    ]
    return sections, problems


@cache
def _adapter(field: str) -> TypeAdapter[Any]:
    known = Manifest.model_fields[field]
    annotation: Any = Annotated[known.annotation, known]
    return TypeAdapter(annotation)
