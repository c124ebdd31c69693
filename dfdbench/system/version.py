"""The version that results, checkpoints and captions name."""

from __future__ import annotations

from importlib.metadata import version

PACKAGE_VERSION = version("dfdbench")
