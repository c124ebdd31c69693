"""Dataset builder and benchmark suite for depth from defocus."""

from importlib.metadata import version

__version__ = version("dfdbench")
