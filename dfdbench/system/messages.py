"""Messages between processes: facts as JSON, arrays of numbers beside them, nothing that runs."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from dfdbench.system.json_text import parse_message

#: Arrays by name; of numbers, or of truth values.
Arrays = dict[str, NDArray[Any]]

_LENGTH = struct.Struct(">Q")
_KINDS = "biufc"
_LONGEST = 2**28


def send(stream: IO[bytes], facts: Mapping[str, Any], arrays: Mapping[str, Any]) -> None:
    """Write a message: the length of its head, the head as JSON, the arrays' bytes.

    Parameters
    ----------
    stream : binary file
        A pipe's end.
    facts : mapping
        Fit for JSON.
    arrays : mapping of str to array_like
        Of numbers.

    Raises
    ------
    TypeError
        Where facts are not fit for JSON.
    """
    whole = {name: np.asarray(value) for name, value in arrays.items()}
    shapes = [(name, array.dtype.str, array.shape) for name, array in whole.items()]
    head = json.dumps({"facts": facts, "arrays": shapes}).encode()
    stream.write(_LENGTH.pack(len(head)) + head)
    for array in whole.values():
        stream.write(array.tobytes())
    stream.flush()


def receive(stream: IO[bytes], most: int = 2**33) -> tuple[dict[str, Any], Arrays]:
    """Read a message; whoever wrote it may be anybody.

    Parameters
    ----------
    stream : binary file
        A pipe's end.
    most : int
        How many bytes its arrays may have together.

    Raises
    ------
    EOFError
        Where the other end is closed.
    ValueError
        Where it is no such message, or is larger.

    Examples
    --------
    >>> import io
    >>> pipe = io.BytesIO()
    >>> send(pipe, {"do": "predict"}, {"levels": np.arange(3.0)})
    >>> _ = pipe.seek(0)
    >>> receive(pipe)
    ({'do': 'predict'}, {'levels': array([0., 1., 2.])})
    """
    (length,) = _LENGTH.unpack(_exactly(stream, _LENGTH.size))
    if length > _LONGEST:
        raise ValueError(f"a head of {length} bytes")
    try:
        head = parse_message(_exactly(stream, length))
        facts, shapes = (
            dict(head["facts"]),
            [(str(n), np.dtype(d), s) for n, d, s in head["arrays"]],
        )
    except (LookupError, TypeError) as error:
        raise ValueError(str(error)) from error
    arrays = {}
    for name, dtype, shape in shapes:
        if dtype.kind not in _KINDS or not all(type(size) is int and size >= 0 for size in shape):
            raise ValueError(f"{name}: {dtype}, shape {shape}")
        count = int(np.prod([dtype.itemsize, *shape], dtype=object))
        most -= count
        if most < 0:
            raise ValueError(f"{name}: {count} bytes")
        arrays[name] = np.frombuffer(bytearray(_exactly(stream, count)), dtype).reshape(shape)
    return facts, arrays


def _exactly(stream: IO[bytes], count: int) -> bytes:
    content = stream.read(count)
    if len(content) < count:
        raise EOFError
    return content
