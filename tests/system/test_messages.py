import io
import json
import struct
from typing import Any

import numpy as np
import pytest

from dfdbench.system.messages import receive, send


def sent(facts: dict[str, Any], **arrays: Any) -> io.BytesIO:
    pipe = io.BytesIO()
    send(pipe, facts, arrays)
    pipe.seek(0)
    return pipe


def forged(head: Any, content: bytes = b"") -> io.BytesIO:
    text = head if isinstance(head, bytes) else json.dumps(head).encode()
    return io.BytesIO(struct.pack(">Q", len(text)) + text + content)


@pytest.mark.parametrize(
    "array",
    [
        np.arange(12, dtype=np.uint8).reshape(2, 2, 3)[:, ::-1],
        np.array([[True], [False]]),
        np.array(0.1),
        np.zeros((0, 3), np.float32),
        np.array([1 + 2j], ">c16"),
        np.array([np.nan, np.inf]),
    ],
)
def test_what_is_sent_comes_bit_for_bit(array: Any) -> None:
    facts, arrays = receive(sent({"a": [1, None, "\udc80"]}, one=array, two=3))
    assert facts == {"a": [1, None, "\udc80"]}
    assert (arrays["one"].dtype, arrays["one"].shape) == (array.dtype, array.shape)
    assert arrays["one"].tobytes() == array.tobytes()
    assert arrays["two"] == 3
    # A method may write into what it is handed.
    assert arrays["one"].flags.writeable


@pytest.mark.parametrize(
    "stream",
    [
        forged(b"not JSON"),
        forged(b"\xff\xfe"),
        forged([1, 2]),
        forged({"facts": {}}),
        forged({"facts": 3, "arrays": []}),
        forged({"facts": {}, "arrays": [["a", "no type", [1]]]}),
        forged({"facts": {}, "arrays": [["a", "O", [1]]]}, bytes(8)),
        forged({"facts": {}, "arrays": [["a", "S8", [1]]]}, bytes(8)),
        forged({"facts": {}, "arrays": [["a", "u1", [-1]]]}),
        forged({"facts": {}, "arrays": [["a", "u1", [1.5]]]}),
        forged({"facts": {}, "arrays": [["a", "u1", [2**40, 2**40]]]}),
        forged({"facts": {}, "arrays": [["a", "u1", [60]], ["b", "u1", [60]]]}, bytes(120)),
        io.BytesIO(struct.pack(">Q", 2**63)),
        forged(b"[" * 100_000),
    ],
)
def test_what_is_no_message_is_refused_before_memory_is_taken(stream: io.BytesIO) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - what it says is json's, numpy's or ours
        receive(stream, most=100)


def test_a_pipe_that_is_closed_is_told_wherever_that_happens() -> None:
    whole = sent({"a": 1}, levels=np.zeros(9)).getvalue()
    for length in range(len(whole)):
        with pytest.raises(EOFError):
            receive(io.BytesIO(whole[:length]))
