from .architectures import DfDNet, UNet

__all__ = ["DfDNet", "UNet"]
