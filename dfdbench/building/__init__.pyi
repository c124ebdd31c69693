from .build import build_store
from .sources import SceneError, SceneImages, Source, open_source

__all__ = ["SceneError", "SceneImages", "Source", "build_store", "open_source"]
