"""How a defocus image comes about."""

import lazy_loader

# Names are imported on first use: reading a manifest needs neither numba nor torch.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
