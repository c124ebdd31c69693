import hashlib
import json
import re
from dataclasses import asdict, fields
from typing import Any

import pytest

from dfdbench.blur.formation import uniform_numbers
from dfdbench.blur.tracks import CLEAN, DISK, STACKS, TRACKS, Formation, Track, find_degradation
from dfdbench.errors import UnknownNameError

#: The fields of a formation that the first tracks were released with.
RELEASED = {"sigma_min", "sigma_step", "exponent", "layers", "shift", "gain", "noise"}
RELEASED |= {"linear", "read_noise", "full_well"}


def test_the_released_definitions_never_change() -> None:
    # A change would be a new version of the track.
    texts = {name: json.dumps(_definition(track), sort_keys=True) for name, track in TRACKS.items()}
    hashes = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}
    assert hashes == {
        "noise": "77ce08300408cdf691db0e5146e99ab93393f83f9dc3e0012188a27f6b1c5eb3",
        "psf": "0425b16b514d4d4b9cc0746609811d337c0e911f1be5c010494be6733f9ffaac",
        "law": "26d89391d06617bfcc91500ac5f5d67f230127f9c6cc493a906b80e801f0fe96",
        "occlusion": "28968f8fcbe59f546b9bc53ab6c1b685fbd6dc4ab4096abe5c059e74cce471ff",
        "shift": "ba67571540bda212c70e7c5d0b90ab22a2b15b45e9476167cfec1402fffd4233",
        "gain": "107a71fff596ba7ac88fb77920d71b70726c9b4a31633a3d4a13630a17ba538f",
        "camera": "d520aa70a0d4e06e349824c85357114ce8740807cf6f37679e96ce08a6c4deed",
        "magnification": "978a974b00013555f18bc37351fedf39681c72baf86d03e9e2844fb0b303eac9",
        "vignetting": "a858b3cc0147f9cb946c36c915f1bcd48ee68cbc5dfc0aa5807a7603f0220f53",
        "colour": "b7ad38e00628560fdecf4a77089d72d3e67c567e2eccea6af69014ccb4deb373",
        "lens": "537ffb53a8efd78f3f0e23df3d0cdf4368d5294c51077e780cc77c828c9c6651",
    }


def _definition(track: Track) -> dict[str, Any]:
    # A field that came later says nothing of a track that was released before, which leaves it
    # at its default.
    said = asdict(track)
    said["severities"] = [
        {k: v for k, v in formation.items() if k in RELEASED or v != getattr(Formation(), k)}
        for formation in said["severities"]
    ]
    return said


def test_severity_0_is_clean_and_each_further_one_is_another() -> None:
    for name, track in TRACKS.items():
        assert find_degradation(f"{name}-0").label == CLEAN
        assert find_degradation(f"{name}-0").formation == Formation()
        assert len({Formation(), *track.severities}) == len(track.steps) + 1 == 4
        for label in (f"{name}-1", f"{name}-2", f"{name}-3"):
            assert find_degradation(label).label == label


def test_each_formation_s_field_is_used_by_some_track() -> None:
    used = {
        field.name
        for field in fields(Formation)
        for track in (*TRACKS.values(), *STACKS.values())
        for formation in track.severities
        if getattr(formation, field.name) != field.default
    }
    assert used == {field.name for field in fields(Formation)}
    assert TRACKS["camera"].severities[0].exponent == DISK


def test_the_hidden_law_was_drawn_not_chosen() -> None:
    for severity, width in enumerate((0.1, 0.2, 0.4), 1):
        formation = TRACKS["law"].severities[severity - 1]
        for field in ("sigma_min", "sigma_step"):
            size, side = uniform_numbers(2, "law", 1, severity, field)
            drawn = 1 + width * (0.5 + size / 2) * (1 if side > 0.5 else -1)
            assert getattr(formation, field) == round(drawn, 4)


def test_how_light_falls_off_was_drawn_not_chosen() -> None:
    for severity, share in enumerate((0.1, 0.2, 0.35), 1):
        second, fourth = TRACKS["vignetting"].severities[severity - 1].falloff
        assert second == round(share * uniform_numbers(1, "vignetting", 1, severity)[0], 4)
        assert second + fourth == pytest.approx(share)


def test_near_misses_are_named() -> None:
    for label, said in (
        ("camra-2", "did you mean camera"),
        ("camera-4", "did you mean camera-"),
        ("camera-" + "9" * 5000, "unknown track"),
        ("noise1", "did you mean noise-1"),
        ("Noise-2", "did you mean noise-2"),
        ("noise", "did you mean noise-"),
        ("clean", "unknown track"),
        ("", "unknown track"),
    ):
        with pytest.raises(UnknownNameError, match=re.escape(said)):
            find_degradation(label)
