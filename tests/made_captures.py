"""Small real-world captures, for the tests of what reads them."""

from pathlib import Path

from dfdbench.building.sources.realworld import RawScene, find_captured_scene
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest

STEPS = (129, 135, 141)


def manifest_with_few_steps(name: str) -> Manifest:
    """A released manifest, with three of its seventeen voltage steps and a version of its own."""
    own = {"voltage_step ": f"voltage_step = {list(STEPS)}", "version ": "version = 99"}
    lines = find_manifest(name).toml.splitlines()
    few = [next((own[key] for key in own if line.startswith(key)), line) for line in lines]
    return parse_manifest("\n".join(few).encode(), f"{name}-99.toml")


def raw_scene(folder: Path, name: str) -> RawScene:
    capture = find_manifest("realworld").capture
    assert capture is not None
    scene = find_captured_scene(folder, name, capture)
    assert isinstance(scene, RawScene)
    return scene
