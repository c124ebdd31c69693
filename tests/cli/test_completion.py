import os
import subprocess
import sys

import pytest


@pytest.mark.slow
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("lead", ["leaderboard"]),
        ("run --dataset middle", ["middlebury", "middlebury-default"]),
        ("tracks --method graph-cuts-", ["graph-cuts-rounded"]),
        ("build nothing-begins-so", []),
    ],
)
def test_the_shell_is_offered_what_begins_so(typed: str, offered: list[str]) -> None:
    words = f"dfdbench {typed}"
    asked = {
        "_DFDBENCH_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split()) - 1),
    }
    program = "import sys; sys.argv = ['dfdbench']; from dfdbench.cli import app; app()"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | asked,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == offered, done.stderr
