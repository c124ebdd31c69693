"""What is said of the machine does not change it."""

import sys
from subprocess import run

PROGRAM = """
import numba
from dfdbench.methods.process_state import process_kept
from dfdbench.results.environment import describe_environment
with process_kept():
    print(describe_environment().threads["numba"] == numba.config.NUMBA_NUM_THREADS)
numba.threading_layer()
"""


def test_numbas_threads_which_reset_those_of_torch_are_not_started() -> None:
    done = run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False)
    assert done.stdout == "True\n"
    assert "Threading layer is not initialized" in done.stderr
