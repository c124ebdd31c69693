"""Dataset builder and benchmark suite for depth from defocus."""

import lazy_loader

# Names are imported on first use, so that the command line starts quickly.
_attached, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]


def __getattr__(name: str) -> object:
    if name == "__version__":
        from dfdbench.system.packages import PACKAGE_VERSION

        return PACKAGE_VERSION
    return _attached(name)
