import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.depth_scale import DepthScale, Rig
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import MethodError
from dfdbench.evaluation.lens import given_by_lens, lens_law, rig_of
from dfdbench.evaluation.loading import load_for
from dfdbench.evaluation.plan import RunOptions
from dfdbench.evaluation.run import run_method
from dfdbench.results.wording import given_to

SCALE = DepthScale(law="inverse", near=0.5, far=4.0)
FACTS: dict[str, Any] = {"focal_length": 0.05, "defocus_f_number": 2.0}
FACTS |= {"focus_distance": 1.05, "pixel_pitch": 1e-4}
LENS = {**FACTS, "scale": SCALE.model_dump()}


def of_manifest(manifest: Manifest, rig: Rig | None, scale: DepthScale | None) -> Manifest:
    depth = manifest.depth.model_copy(update={"scale": scale})
    return manifest.model_copy(update={"depth": depth, "rig": rig})


def test_the_law_is_the_thin_lens_equation_by_hand() -> None:
    # Aperture 0.05 / 2 = 25 mm; image distance of the focus 0.05 * 1.05 / 1.00 = 52.5 mm. A point
    # at 0.5 m is imaged at 0.05 * 0.5 / 0.45 = 55.5556 mm: a disk of 25 mm * (55.5556 - 52.5) /
    # 55.5556 = 1.375 mm, 13.75 pixels wide, and a quarter of that is its standard deviation.
    law = lens_law(LENS)
    assert law.sigmas[255] == pytest.approx(13.75 / 4)
    # At 4 m: imaged at 0.2 / 3.95 = 50.6329 mm; 25 * (52.5 - 50.6329) / 50.6329 = 0.921875 mm.
    assert law.sigmas[1] == pytest.approx(9.21875 / 4)
    assert law.sigmas[0] == law.sigmas[1], "nothing is farther than far"
    assert min(law.sigmas) == law.sigmas[int(SCALE.to_levels(np.array(1.05)))] == 0.1
    assert law.kernel_size == 2 * math.ceil(3 * 13.75 / 4) + 1
    # Blur of the in-focus image is taken off: of twice the f-number, half the width, three
    # quarters of the variance are left.
    law = lens_law({**LENS, "infocus_f_number": 4.0})
    assert law.sigmas[255] == pytest.approx(13.75 / 4 * math.sqrt(0.75))
    law = lens_law({**LENS, "noise": [2.0], "registered": False, "exponent": 4, "kernel_size": 9})
    assert (law.noise, law.registered, law.exponent, law.kernel_size) == ((2.0,), False, 4, 9)


def test_a_lens_that_is_none_is_told() -> None:
    cases: list[tuple[dict[str, Any], list[str]]] = [
        ({"focal_length": None, "scale": None}, ["no focal_length, scale", "recipe=FILE.toml"]),
        ({"colour": 1, "sigma_min": 2.0}, ["unknown field", "colour", "sigma_min"]),
        ({"focal_length": "5cm", "pixel_pitch": True}, ["focal_length", "pixel_pitch"]),
        ({"focus_distance": 0.01}, ["no real image", "lens: focus_distance"]),
        ({"scale": {"near": 4.0, "far": 0.5, "law": "linear"}}, ["near is not before far"]),
        ({"noise": "much"}, ["wrong blur law", "noise"]),
        ({"pixel_pitch": 1e-7}, ["focal_length, focus_distance, pixel_pitch", "got 3438"]),
        ({"defocus_f_number": 0.001}, ["too much blur", "defocus_f_number"]),
    ]
    for changes, parts in cases:
        with pytest.raises(MethodError) as raised:
            lens_law({name: v for name, v in {**LENS, **changes}.items() if v is not None})
        assert all(part in str(raised.value) for part in parts), raised.value


def test_a_manifests_rig_is_told_a_file_fills_up(tiny_manifest: Manifest, tmp_path: Path) -> None:
    whole = of_manifest(tiny_manifest, Rig(**FACTS), SCALE)
    taken, recorded = given_by_lens(whole, {"recipe": "rig", "window": 9})
    assert (taken, recorded) == ({"recipe": lens_law(LENS), "window": 9}, {"recipe": "rig"})
    part = of_manifest(tiny_manifest, Rig(focus_distance=9.0, defocus_f_number=2.0), SCALE)
    file = tmp_path / "mine.toml"
    file.write_text("focal_length = 0.05\npixel_pitch = 1e-4\nfocus_distance = 1.05\n")
    taken, recorded = given_by_lens(part, {"recipe": str(file)})
    assert taken == {"recipe": lens_law(LENS)}
    # Whole, so that it can be run again without the file.
    assert recorded["recipe"] == LENS
    assert given_by_lens(part, recorded) == (taken, recorded)
    # A file may say nothing of the lens itself.
    taken, _ = given_by_lens(whole, {"recipe": {"linear": True, "exponent": 32.0}})
    assert taken == {"recipe": lens_law({**LENS, "linear": True, "exponent": 32.0})}
    with pytest.raises(MethodError, match="no focal_length, pixel_pitch"):
        given_by_lens(part, {"recipe": "rig"})
    with pytest.raises(MethodError, match="no defocus_f_number, focal_length"):
        given_by_lens(tiny_manifest, {"recipe": "rig"})


class Told:
    def __init__(self, rig: Rig) -> None:
        self.rig = rig

    def __call__(self, infocus: Any, defocus: Any) -> Any: ...


def test_a_constructor_gets_the_facts_that_are_known(tiny_store: Dataset) -> None:
    assert load_for(tiny_store, Told, {}).predict.rig == Rig()  # type: ignore[attr-defined]
    tiny_store.manifest = of_manifest(tiny_store.manifest, Rig(focal_length=0.05, far=3.0), SCALE)
    rig = load_for(tiny_store, Told, {}).predict.rig  # type: ignore[attr-defined]
    assert (rig.focal_length, rig.pixel_pitch) == (0.05, None)
    assert (rig.near, rig.far) == (0.5, 3.0), "the levels' ends where the rig does not say"
    assert rig == rig_of(tiny_store.manifest)


def test_a_run_says_that_a_lens_was_told(tiny_store: Dataset, tmp_path: Path) -> None:
    tiny_store.manifest = of_manifest(tiny_store.manifest, Rig(**FACTS), SCALE)
    for recipe in ("rig", LENS):
        loaded = load_for(tiny_store, "local", {"recipe": recipe})
        result = run_method(tiny_store, loaded, "Two", tmp_path / "o", RunOptions(limit=1)).result
        assert (result.method.parameters, given_to(result)) == ({"recipe": recipe}, "the lens")
