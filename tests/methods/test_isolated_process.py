"""What runs in a method's process is seen from outside in test_isolated.py; here, how it ends."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.system.made_child import gone

BUSY = """
import os, signal, sys
from pathlib import Path
import numpy as np
from dfdbench.methods.isolated import Order, load_isolated

method = load_isolated(Order(sys.argv[1], {}, {}, {}, 0, ()), ())
print(method.predict._process._popen.pid, flush=True)
image = np.zeros((4, 4, 3), np.uint8)
import threading
threading.Timer(1.0, lambda: os.kill(os.getpid(), signal.SIGKILL)).start()
method.predict(image, image)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="kills as Linux does")
def test_a_busy_method_ends_with_a_run_that_is_killed(tmp_path: Path) -> None:
    (tmp_path / "busy.py").write_text("def predict(infocus, defocus):\n    while True: pass\n")
    python = [sys.executable, "-c", BUSY, f"{tmp_path / 'busy.py'}:predict"]
    done = subprocess.run(python, stdout=subprocess.PIPE, text=True, check=False)
    assert done.returncode == -9
    assert gone(int(done.stdout))
