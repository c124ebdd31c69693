"""The reference of file formats, written out of the models that read and write the files."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from dfdbench.board.row_file import Row
from dfdbench.datasets.manifest import Manifest
from dfdbench.results.record import Result
from dfdbench.tables.render import escape_markdown
from dfdbench.training.configuration import TrainingConfiguration

HEAD = """# File formats

Written from the models that read the files when this site is built. A file that does not fit is
refused, with the field, what was expected and what was found. JSON schemas:
[a result](../files/result-1.json), [coverage](../files/coverage-1.json).

Beside these there are a built data set, one [zarr](https://zarr.dev) store (format 3) with a group
a scene, and `predictions.zarr`, a run's depth maps; xarray opens both as they are.
"""
FILES: tuple[tuple[str, str, type[BaseModel]], ...] = (
    ("A manifest", "`NAME-VERSION.toml`: what a data set consists of.", Manifest),
    ("A result", "`result.json` of a run.", Result),
    ("A row of the leaderboard", "A method's runs on a split, in one file.", Row),
    ("A training configuration", "`dfdbench train --config FILE.toml`.", TrainingConfiguration),
)


def formats_page() -> str:
    """Return the page: for each file its fields, with type and default."""
    parts = [HEAD]
    for title, what, model in FILES:
        schema = model.model_json_schema()
        parts += [f"\n## {title}\n", f"{what}\n", _fields(schema)]
        for name, inner in schema.get("$defs", {}).items():
            if inner.get("type") == "object":
                parts += [f"\n### {title}: {name}\n", _text(inner), _fields(inner)]
    return "\n".join(parts)


def _text(schema: Mapping[str, Any]) -> str:
    paragraphs = inspect.cleandoc(schema.get("description", "")).split("\n\n")
    plain = [" ".join(paragraph.split()) for paragraph in paragraphs if "-----" not in paragraph]
    return (
        "\n\n".join(
            escape_markdown(text).replace("\\`\\`", "`").replace("\\`", "`") for text in plain
        )
        + "\n"
    )


def _fields(schema: Mapping[str, Any]) -> str:
    needed = schema.get("required", ())
    lines = ["| field | type | default |", "|:---|:---|:---|"]
    for name, field in schema.get("properties", {}).items():
        default = "needed" if name in needed else f"`{json.dumps(field.get('default'))}`"
        if name not in needed and "default" not in field:
            default = "empty"
        lines.append(f"| `{name}` | {escape_markdown(_type(field))} | {default} |")
    return "\n".join(lines) + "\n"


def _type(field: Mapping[str, Any]) -> str:
    if "$ref" in field:
        return str(field["$ref"]).rpartition("/")[2]
    if "anyOf" in field:
        return " or ".join(dict.fromkeys(map(_type, field["anyOf"])))
    if "const" in field or "enum" in field:
        values = field.get("enum", [field.get("const")])
        return ", ".join(json.dumps(value) for value in values)
    kind = str(field.get("type", field.get("title", "anything")))
    if kind == "array":
        return f"list of {_type(field.get('items', {}))}"
    inner = field.get("additionalProperties")
    if kind == "object" and isinstance(inner, dict):
        return f"table of {_type(inner)}"
    return {"object": "table", "null": "none", "number": "number"}.get(kind, kind)
