from .method import Method
from .registry import load, load_method, registered_methods

__all__ = ["Method", "load", "load_method", "registered_methods"]
