import pytest
from pydantic import ValidationError

from dfdbench.datasets.captured_files import CapturedFiles, fill, places_in


def test_what_stands_in_braces_is_filled_and_nothing_else() -> None:
    # As text, never as a format: a manifest must not reach into objects.
    assert places_in("{scene.__class__}/{0}") == ("scene.__class__", "0")
    with pytest.raises(KeyError):
        fill("{scene.__class__}", {"scene": "desk"})
    assert fill("{scene}/{image}.JPG", {"scene": "a", "image": "{scene}"}) == "a/{scene}.JPG"


def test_each_kind_of_file_that_is_there_has_its_pattern() -> None:
    files = CapturedFiles(infocus="a", images="b", depth="c")
    assert files.patterns == {"infocus": "a", "images": "b", "depth": "c"}
    assert (files.align, files.match_gain, files.depth_missing) == ("none", False, [0])
    with pytest.raises(ValidationError):
        CapturedFiles(infocus="a", defocus="b", depth="c", depth_unit=0.0)
