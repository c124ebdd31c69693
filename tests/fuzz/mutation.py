"""Change files as bad luck and bad will do: bytes, lines, cells, and parts of what a file says."""

import json
import struct
from collections.abc import Callable, Iterator
from copy import deepcopy
from random import Random
from typing import Any

#: Text that a name, a path or a number should not be.
STRANGE_TEXTS = (
    *("", " ", ".", "..", "../up", "/", "a/b", "a\\b", "C:x", "~", "-", "--", "=", "@", "%s", "{}"),
    *("a" * 130, "a" * 300, "a/" * 1500, "é", "日本", "\u202e", "\ud800", "\x00", "\r\n"),
    *("zarr.json", "depth", "x", "y", "channel", "available", "infocus", "valid", "all", "test"),
    *("0", "-1", "nan", "1e999", "1" * 5000, "null", "[", "{", "[" * 3000, "1-9999999999"),
    "\x1b[2J",
)
STRANGE_NUMBERS: tuple[int | float, ...] = (
    *(0, 1, -1, 2, 3, 255, 256, 2**16, 2**31 - 1, 2**31, 2**53 + 1, 2**63, 2**64, 10**30),
    *(0.5, -0.0, 1e308, -1e308, 1e-320, float("nan"), float("inf"), -float("inf"), -(10**30)),
)
_STRANGE: tuple[Any, ...] = (None, True, False, [], {}, [[]], {"": {}}, *STRANGE_NUMBERS)
_MAGIC = (b"\0", b"\xff" * 4, b"\0" * 8, b"\x7f\xff\xff\xff", b"\x80", b"\r\n", b'"', b"\xed\xa0")


def changed_bytes(random: Random, content: bytes) -> bytes:
    """Flip, cut, double, insert or replace some bytes."""
    data = bytearray(content)
    for _ in range(random.choice((1, 1, 2, 8))):
        place = random.randrange(len(data) + 1)
        end = min(len(data), place + random.choice((1, 2, 4, 16, 256)))
        match random.randrange(6):
            case 0 if place < len(data):
                data[place] ^= 1 << random.randrange(8)
            case 1:
                del data[place:end]
            case 2:
                data[place:place] = data[place:end] * random.choice((1, 2, 50))
            case 3:
                data[place:place] = random.choice(_MAGIC)
            case 4:
                data[place:end] = random.randbytes(end - place)
            case _:
                del data[place:]
    return bytes(data)


def changed_text(random: Random, text: str) -> str:
    """Drop, double, swap or spoil lines and words."""
    lines = text.split("\n")
    for _ in range(random.choice((1, 1, 2, 4))):
        number = random.randrange(len(lines))
        match random.randrange(4):
            case 0:
                del lines[number]
            case 1:
                lines.insert(random.randrange(len(lines) + 1), lines[number])
            case 2:
                words = lines[number].split(" ")
                words[random.randrange(len(words))] = random.choice(STRANGE_TEXTS)
                lines[number] = " ".join(words)
            case _:
                place = random.randrange(len(lines[number]) + 1)
                lines[number] = lines[number][:place] + random.choice(STRANGE_TEXTS)
        lines = lines or [""]
    return "\n".join(lines)


def changed_cells(random: Random, text: str) -> str:
    """Spoil cells of a CSV file, or its lines."""
    if random.random() < 0.3:
        return changed_text(random, text)
    rows = [line.split(",") for line in text.split("\n")]
    for _ in range(random.choice((1, 1, 3))):
        row = random.choice(rows)
        strange = random.choice((*STRANGE_TEXTS, *map(str, STRANGE_NUMBERS)))
        row[random.randrange(len(row))] = strange
        if random.random() < 0.2:
            row.append(strange)
    return "\n".join(",".join(row) for row in rows)


def _places(value: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield above
    if isinstance(value, dict):
        for key in value:
            yield from _places(value[key], (*above, key))
    elif isinstance(value, list):
        for number, part in enumerate(value):
            yield from _places(part, (*above, number))


def _at(value: Any, place: tuple[Any, ...]) -> Any:
    for key in place:
        value = value[key]
    return value


def _strange(random: Random, old: Any) -> Any:
    match old:
        case bool():
            return random.choice((not old, None, 2, "true"))
        case int() | float() if random.random() < 0.7:
            return random.choice((*STRANGE_NUMBERS, old + 1, -old, old * 1000))
        case str() if random.random() < 0.7:
            return random.choice((*STRANGE_TEXTS, old + "x", old[:-1], old.upper(), old + old))
        case list() if old and random.random() < 0.6:
            return old[:-1] if random.random() < 0.5 else [*old, random.choice(old)]
    return random.choice((*_STRANGE, *STRANGE_TEXTS))


def _nested(random: Random) -> Any:
    deep: Any = []
    for _ in range(random.choice((50, 3000))):
        deep = [deep] if random.random() < 0.9 else {"a": deep}
    return deep


def changed_tree(random: Random, value: Any) -> Any:
    """Change parts of what JSON or TOML says: values, keys, what is listed, where it stands."""
    value = deepcopy(value)
    for _ in range(random.choice((1, 1, 1, 2, 3))):
        places = [place for place in _places(value) if place]
        if not places:
            return _strange(random, value)
        *above, key = random.choice(places)
        parent = _at(value, tuple(above))
        match random.randrange(8):
            case 0:
                del parent[key]
            case 1 if isinstance(parent, dict):
                parent[random.choice(STRANGE_TEXTS)] = parent.pop(key)
            case 2 if isinstance(parent, dict):
                parent[random.choice(STRANGE_TEXTS)] = deepcopy(parent[key])
            case 2:
                parent.insert(random.randrange(len(parent) + 1), deepcopy(parent[key]))
            case 3:
                parent[key] = deepcopy(_at(value, random.choice(places)))
            case 4 if isinstance(parent[key], list):
                parent[key] = parent[key] * random.choice((2, 300))
            case 5 if random.random() < 0.1:
                # Too deep for a second change to find its way through it.
                parent[key] = _nested(random)
                return value
            case _:
                parent[key] = _strange(random, parent[key])
    return value


def as_json(value: Any) -> bytes:
    """Return JSON, however strange; what is nested too deep for Python is written by hand."""
    try:
        return json.dumps(value).encode()
    except RecursionError:
        return b'{"a": ' + b"[" * 5000 + b"]" * 5000 + b"}"


def as_toml(content: Any) -> bytes:
    """Return a mapping as TOML, a line a key, sections inline."""
    if not isinstance(content, dict):
        return _toml_value(content).encode("utf-8", "surrogatepass")
    lines = [f"{json.dumps(str(key))} = {_toml_value(part)}" for key, part in content.items()]
    return ("\n".join(lines) + "\n").encode("utf-8", "surrogatepass")


def _toml_value(value: Any, depth: int = 0) -> str:
    match value:
        case _ if depth > 300:
            return "[" * 3000 + "]" * 3000
        case None:
            return '""'
        case dict():
            held = value.items()
            parts = (f"{json.dumps(str(k))} = {_toml_value(v, depth + 1)}" for k, v in held)
            return "{" + ", ".join(parts) + "}"
        case list():
            return "[" + ", ".join(_toml_value(part, depth + 1) for part in value) + "]"
        case bool():
            return str(value).lower()
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)


def changed_npy(random: Random, content: bytes) -> bytes:
    """Change what a ``.npy`` file says of its array, or its bytes."""
    if random.random() < 0.3:
        return changed_bytes(random, content)
    shapes = ("()", "(0,)", "(3,)", "(4, 0)", "(-1, 4)", "(99999999, 99999999)", "[4]")
    shape = random.choice(shapes)
    kind = random.choice(("<i4", "<f8", ">i2", "|O", "<U9", "|b1", "<c16", "|V4", "<M8[s]", "<i8"))
    head = f"{{'descr': {kind!r}, 'fortran_order': False, 'shape': {shape}, }}"
    head += " " * (63 - (10 + len(head)) % 64) + "\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + content[128:]


def of_text(change: Callable[[Random, str], str]) -> Callable[[Random, bytes], bytes]:
    """Return a change of text as one of bytes."""

    def changed(random: Random, content: bytes) -> bytes:
        return change(random, content.decode()).encode("utf-8", "surrogatepass")

    return changed


def changed_json(random: Random, content: bytes) -> bytes:
    """Change what a JSON file says, or its bytes."""
    if random.random() < 0.15:
        return changed_bytes(random, content)
    return as_json(changed_tree(random, json.loads(content)))


def changed_toml(random: Random, content: bytes) -> bytes:
    """Change what a TOML file says, its lines, or its bytes."""
    import tomllib

    chance = random.random()
    if chance < 0.1:
        return changed_bytes(random, content)
    if chance < 0.25:
        return of_text(changed_text)(random, content)
    return as_toml(changed_tree(random, tomllib.loads(content.decode())))


#: By a file's suffix; all others are changed by their bytes.
CHANGES: dict[str, Callable[[Random, bytes], bytes]] = {
    ".toml": changed_toml,
    ".json": changed_json,
    ".csv": of_text(changed_cells),
    ".npy": changed_npy,
    ".lock": of_text(changed_text),
}
