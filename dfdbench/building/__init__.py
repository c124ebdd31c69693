"""Build a data set from raw files."""

import lazy_loader

# Names are imported on demand: what they need takes a while to import.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
