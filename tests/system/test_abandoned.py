"""What asyncio prints of tasks that zarr gave up does not reach a user."""

import logging
import subprocess
import sys

import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.system.abandoned import keep_quiet_of_abandoned_tasks

# The garbage collector comes by when it likes: here it is called.
_TWENTY_TIMES = """
import gc, sys, time
from dfdbench.cli import main
for _ in range(20):
    sys.argv = ["dfdbench", "info", sys.argv[-1]]
    try:
        main()
    except SystemExit as ended:
        assert ended.code == 2
    gc.collect()
    time.sleep(0.02)
"""


def test_a_store_with_several_damaged_scenes_is_one_error(tiny_store: Dataset) -> None:
    path = tiny_store.path
    first, *others = tiny_store.scenes
    (path / first / "zarr.json").write_text("{")
    for scene in others:
        (path / scene / "zarr.json").unlink()
    done = subprocess.run(
        [sys.executable, "-c", _TWENTY_TIMES, str(path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert "cannot read the store" in done.stderr
    assert "Traceback" not in done.stderr
    assert "Task" not in done.stderr


def test_what_else_asyncio_says_is_said(caplog: pytest.LogCaptureFixture) -> None:
    keep_quiet_of_abandoned_tasks()
    logger = logging.getLogger("asyncio")
    logger.error("Task exception was never retrieved\nfuture: <Task>")
    logger.error("socket.send() raised exception")
    assert [record.getMessage() for record in caplog.records] == ["socket.send() raised exception"]
