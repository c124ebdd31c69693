from importlib.util import find_spec

from tests.one_torch_thread import one_torch_thread

__all__ = ["one_torch_thread"]

# Without PyTorch there is nothing to test here.
collect_ignore_glob = [] if find_spec("torch") else ["*"]
