"""The networks: architecture, widths, weights, inference."""

from dfdbench.methods.networks.architectures import DfDNet, UNet

__all__ = ["DfDNet", "UNet"]
