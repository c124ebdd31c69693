import json

import pytest

from dfdbench.cli.options import parse_length, pool_of, pool_of_processes, value_of, values_of
from dfdbench.errors import InputError
from dfdbench.system.parallel import Cluster, Processes, Threads
from tests.process import python


def test_a_value_is_json_or_text() -> None:
    as_json = {"a": 9, "b": None, "c": {"sigma_min": 0.2}, "d": "9", "e": "{x}"}
    given = [f"{name}={json.dumps(value)}" for name, value in as_json.items()]
    read = values_of([*given, "f=published", "g=a=b"], "--param")
    assert read == as_json | {"f": "published", "g": "a=b"}


def test_broken_json_and_what_is_no_name_and_value_are_told() -> None:
    for text, why in (
        ("{sigma_min: 0.2}", "double quotes at character 2 of {sigma_min: 0.2}"),
        (" [1, 2", "at character 7"),
    ):
        with pytest.raises(InputError, match="broken JSON") as caught:
            values_of([f"recipe={text}"], "--param")
        assert caught.value.problems[0].where == "--param recipe"
        assert why in caught.value.problems[0].what
    with pytest.raises(InputError, match="--values"):
        value_of("[1", "--values")
    with pytest.raises(InputError, match="2 problems") as caught:
        values_of(["window", "a=1", "=2"], "--set")
    assert [problem.got for problem in caught.value.problems] == ["window", "=2"]
    assert {problem.where for problem in caught.value.problems} == {"--set"}


def test_where_work_is_done() -> None:
    assert isinstance(pool_of(3), Threads)
    assert isinstance(pool_of(None, "tcp://node1:8786"), Cluster)
    assert isinstance(pool_of_processes(2, None), Processes)
    assert isinstance(pool_of_processes(None, "tcp://node1:8786"), Cluster)
    # One pair at a time, here: its time is that of the method alone.
    assert pool_of_processes(None, None) is None
    assert pool_of_processes(1, None) is None
    for pool in (pool_of, pool_of_processes):
        with pytest.raises(InputError, match="--workers cannot be given with --scheduler"):
            pool(2, "tcp://node1:8786")


@pytest.mark.slow
def test_the_shell_is_offered_what_begins_so() -> None:
    program = "import sys; sys.argv = ['dfdbench']; from dfdbench.cli import app; app()"
    for typed, offered in (
        ("lead", ["leaderboard"]),
        ("run --dataset middle", ["middlebury", "middlebury-default"]),
        ("tracks --method graph-cuts-", ["graph-cuts-rounded"]),
        ("build nothing-begins-so", []),
    ):
        asked = {"COMP_WORDS": f"dfdbench {typed}", "COMP_CWORD": str(len(typed.split()))}
        done = python("-c", program, cwd=None, _DFDBENCH_COMPLETE="complete_bash", **asked)
        assert done.stdout.split() == offered, done.stderr


def test_a_length_is_read_in_metres() -> None:
    lengths = {"9.6mm": 9.6e-3, "0.5m": 0.5, "4.8um": 4.8e-6, "4.8µm": 4.8e-6, " 3 cm ": 0.03}
    for text, metres in lengths.items():
        assert parse_length(text, "--pixel") == pytest.approx(metres, rel=1e-15)
    for text in ("9.6", "mm", "-1m", "0m", "1 inch", "nanm", "1e999m", ""):
        with pytest.raises(InputError, match="--pixel"):
            parse_length(text, "--pixel")
