"""What reads a file that no cheap command line comes to."""

from collections.abc import Callable
from pathlib import Path

from dfdbench.building.fetching import archive_members, known_checksums, read_member
from dfdbench.building.sources import image_files
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.manifest_file import parse_manifest
from dfdbench.evaluation.map_files import find_predictions
from dfdbench.methods.parameters import read_parameters
from dfdbench.optics.lens_table import rank_pairs, read_lens_table
from dfdbench.rig.lidar import read_beams, read_ranges
from dfdbench.rig.registration import read_registration
from tests.conftest import TINY_TOML


def _checksums(path: Path) -> None:
    known_checksums(parse_manifest(TINY_TOML.encode(), "tiny-1.toml"), path.parent)


def _archive(path: Path) -> None:
    for name in archive_members(path):
        read_member(path, name)


def _configuration(path: Path) -> None:
    from dfdbench.training.configuration import read_configuration

    configuration = read_configuration(str(path))
    configuration.architecture("dfd-net")


def _weights(path: Path) -> None:
    from dfdbench.methods.networks.weights import load_weights

    load_weights(path, "dfd-net")


def _maps(path: Path) -> None:
    folder = next(above for above in path.parents if above.name == "maps")
    find_predictions(folder, Dataset(folder.parent / "tiny.zarr"), "test", "levels")


def _python(path: Path) -> None:
    # For the tests of the watch itself.
    exec(compile(path.read_text("utf-8"), str(path), "exec"), {})


READERS: dict[str, Callable[[Path], object]] = {
    "archive": _archive,
    "python": _python,
    "checksums": _checksums,
    "png-photograph": lambda path: image_files.decode_image(path.read_bytes(), str(path)),
    "png-depth": lambda path: image_files.decode_levels(path.read_bytes(), str(path), 0),
    "photograph": lambda path: image_files.read_photograph(path.read_bytes(), str(path)),
    "depth": lambda path: image_files.read_depth_file(path.read_bytes(), str(path), "apply"),
    "recipe": lambda path: read_parameters({"recipe": str(path)}),
    "lens": lambda path: rank_pairs(read_lens_table(path), 1.5, 2.2),
    "beams": lambda path: read_beams(path),
    "ranges": lambda path: read_ranges(path),
    "maps": _maps,
    "registration": lambda path: read_registration(path),
    "configuration": _configuration,
    "weights": _weights,
}
