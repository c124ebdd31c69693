"""What is said of the machine does not change it."""

import os
import sys
from subprocess import run

PROGRAM = """
import numba
from dfdbench.methods.process_state import process_kept
from dfdbench.results.environment import describe_environment
with process_kept():
    print(describe_environment().threads["numba"])
try:
    numba.threading_layer()
except ValueError:
    print("not started")
with process_kept():
    numba.set_num_threads(1)
    print(describe_environment().threads["numba"])
print(numba.get_num_threads())
"""


def test_numbas_threads_which_reset_those_of_torch_are_not_started() -> None:
    environment = os.environ | {"NUMBA_NUM_THREADS": "2"}
    command = [sys.executable, "-c", PROGRAM]
    done = run(command, capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.split("\n") == ["2", "not started", "1", "2", ""]
