import pytest

from dfdbench.cli.captures import capture_of, chosen_numbers, chosen_scenes
from dfdbench.datasets.catalog import find_manifest
from dfdbench.errors import DfdbenchError, InputError

REALWORLD = find_manifest("realworld")
STEPS = range(127, 144)


@pytest.mark.parametrize(
    ("text", "chosen"),
    [
        ("k03", ("k03",)),
        ("k33,k00-k02", ("k00", "k01", "k02", "k33")),
        ("k01-k01, k01", ("k01",)),
        ("k62-k63", ("k62", "k63")),
    ],
)
def test_scenes_come_once_in_the_manifests_order(text: str, chosen: tuple[str, ...]) -> None:
    assert chosen_scenes(text, REALWORLD) == chosen


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("k64", "of k00 to k63"),
        ("k3", "did you mean"),
        ("k00-k64", "got k64"),
        ("k03-k01", "Fix: k01-k03"),
        ("", "unknown scene"),
        ("k01,,k02", "unknown scene"),
    ],
)
def test_scenes_that_are_none_are_told(text: str, told: str) -> None:
    with pytest.raises(DfdbenchError) as caught:
        chosen_scenes(text, REALWORLD)
    assert told in str(caught.value)


@pytest.mark.parametrize(
    ("text", "known", "chosen"),
    [
        ("141, 127-129", STEPS, (127, 128, 129, 141)),
        ("135", STEPS, (135,)),
        # A span may pass over what is not known; its ends may not.
        ("10-40", (10, 20, 40), (10, 20, 40)),
    ],
)
def test_numbers_come_once_and_ascend(
    text: str, known: range | tuple[int, ...], chosen: tuple[int, ...]
) -> None:
    assert chosen_numbers(text, "--steps", known) == chosen


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("140-130", "Fix: 130-140"),
        ("126-130", "unknown value"),
        ("130-150", "unknown value"),
        ("x", "not a list of numbers"),
        ("-130", "not a list of numbers"),
        ("130-135-140", "not a list of numbers"),
        ("", "not a list of numbers"),
    ],
)
def test_numbers_that_are_none_are_told(text: str, told: str) -> None:
    with pytest.raises(InputError, match=told) as caught:
        chosen_numbers(text, "--steps", STEPS)
    if "fix" not in told:
        assert caught.value.problems[0].where == "--steps"


def test_a_set_that_the_rig_did_not_capture_is_told() -> None:
    assert capture_of(REALWORLD) == REALWORLD.capture
    with pytest.raises(InputError, match="not captured by the rig"):
        capture_of(find_manifest("middlebury"))
