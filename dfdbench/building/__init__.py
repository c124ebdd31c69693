"""Raw files to a built set."""

import lazy_loader

# Names come when they are asked for: what they need takes a while to import.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
