"""Call a `torch.nn.Module` as one predicts with it."""

from __future__ import annotations

import sys
from typing import Any

from dfdbench.methods.method import Image


class TorchMethod:
    """A network as a method: in evaluation mode, and without gradients.

    Its attributes are the network's, so that its `fit` or `trained_on` is found.

    Parameters
    ----------
    network : torch.nn.Module
        Called as ``network(infocus, defocus)``.
    """

    def __init__(self, network: Any) -> None:
        self.network = network
        network.eval()

    def __call__(self, infocus: Image, defocus: Image, **parameters: Any) -> Any:
        """Return what the network returns."""
        # Not `inference_mode`: a network may itself switch gradients on for a part of its work.
        with sys.modules["torch"].no_grad():
            # Each time: its own fit or forward may have called train().
            return self.network.eval()(infocus, defocus, **parameters)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute of the network."""
        return getattr(self.__dict__["network"], name)


def as_method(found: Any) -> Any:
    """Return a `TorchMethod` of a network; anything else as it is.

    Examples
    --------
    >>> as_method(len) is len
    True
    """
    # What has not loaded PyTorch is no network.
    torch = sys.modules.get("torch")
    # By its type: what a user wrote may say of itself that it is anything.
    is_network = torch is not None and issubclass(type(found), torch.nn.Module)
    return TorchMethod(found) if is_network else found


def without_gradient(returned: Any) -> Any:
    """Return a tensor as one on the CPU without a gradient, for NumPy; anything else as it is.

    Examples
    --------
    >>> without_gradient([1, 2])
    [1, 2]
    """
    torch = sys.modules.get("torch")
    is_tensor = torch is not None and issubclass(type(returned), torch.Tensor)
    return returned.detach().cpu() if is_tensor else returned
