import base64
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

from dfdbench.errors import UnknownNameError
from dfdbench.report.html import depth_map, inline_svg, photo, write_html
from dfdbench.results.saved_run import SavedRun
from tests.report.conftest import HOSTILE


class Tags(HTMLParser):
    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


@pytest.fixture(scope="module")
def tags(html_page: Path) -> list[tuple[str, dict[str, str | None]]]:
    return Tags(html_page.read_text("utf-8")).found


def test_nothing_is_fetched(tags: list[tuple[str, dict[str, str | None]]]) -> None:
    for tag, attributes in tags:
        for name in ("src", "href", "xlink:href", "action", "srcset"):
            value = attributes.get(name) or "#"
            assert value.startswith(("#", "data:")), (tag, name, value)
    policies = [a for t, a in tags if t == "meta" and "content-security" in str(a).lower()]
    assert "default-src 'none'" in str(policies)


def test_a_name_is_text_never_markup(
    html_page: Path, tags: list[tuple[str, dict[str, str | None]]]
) -> None:
    assert HOSTILE not in html_page.read_text("utf-8")
    assert not [t for t, a in tags if "onerror" in a]
    chosen = [a["value"] for t, a in tags if t == "option" and a.get("value")]
    assert HOSTILE in chosen


def test_each_pair_has_its_pictures_and_each_picture_stands_once(
    html_page: Path, tags: list[tuple[str, dict[str, str | None]]]
) -> None:
    pairs = [a for t, a in tags if t == "article"]
    assert len(pairs) == 36
    places = json.loads(pairs[0]["data-places"] or "")
    assert places.keys() == {"method", "scene", "view", "illumination", "exposure"}
    text = html_page.read_text("utf-8")
    content = re.search(r'id="pictures">(.*?)</script>', text, re.S)
    assert content is not None
    pictures = json.loads(content.group(1))
    assert len(set(pictures.values())) == len(pictures)
    assert {a["data-picture"] for t, a in tags if "data-picture" in a} == pictures.keys()


@pytest.mark.slow
def test_the_same_runs_give_the_same_page(
    html_page: Path, saved_runs: list[SavedRun], tmp_path: Path
) -> None:
    before = html_page.read_bytes()
    again = write_html(saved_runs, "thesis", tmp_path)
    assert again.read_bytes() == before


@pytest.mark.slow
def test_without_pictures_the_page_says_why(saved_runs: list[SavedRun], tmp_path: Path) -> None:
    bare = replace(saved_runs[0], store=None, without="no depth maps lie beside the result")
    text = write_html([bare], "thesis", tmp_path).read_text("utf-8")
    assert "No pictures of constant: no depth maps lie beside the result." in text
    assert "<article" not in text


def test_a_protocol_that_was_not_scored(saved_runs: list[SavedRun], tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError):
        write_html(saved_runs, "theses", tmp_path)


def decoded(address: str) -> NDArray[np.uint8]:
    head, _, content = address.partition(",")
    assert head == "data:image/webp;base64"
    image = cv2.imdecode(np.frombuffer(base64.b64decode(content), np.uint8), cv2.IMREAD_COLOR_RGB)
    assert image is not None
    return np.asarray(image, np.uint8)


def test_a_photo_keeps_its_colours() -> None:
    image = np.zeros((32, 40, 3), np.uint8)
    image[..., 0] = 200
    assert np.abs(decoded(photo(image)).astype(int) - image).max() < 12


def test_unknown_depth_is_grey_and_no_error_is_white() -> None:
    depth = np.full((32, 32), 50.0)
    depth[:, :16] = np.nan
    assert decoded(depth_map(depth, {"cmap": "viridis", "vmin": 0, "vmax": 100}))[
        16, 4
    ] == pytest.approx(191, abs=8)
    assert (
        decoded(depth_map(np.zeros((32, 32)), {"cmap": "PuOr", "vmin": -50, "vmax": 50}))[16, 16]
        > 235
    ).all()


def test_a_figure_is_one_svg_element_named_for_who_cannot_see_it() -> None:
    figure = Figure()
    figure.subplots().set_title("a < b")
    text = inline_svg(figure, 'n "q" <x>')
    assert text.startswith("<svg")
    assert 'aria-label="n &quot;q&quot; &lt;x&gt;"' in text
    assert "a &lt; b" in text


@pytest.mark.parametrize("strange", ["\x00", "\x1b", "\ufffe"])
def test_characters_that_svg_cannot_hold_are_shown_as_replaced(strange: str) -> None:
    figure = Figure()
    figure.subplots().set_title(f"a{strange}b")
    text = inline_svg(figure, f"c{strange}d")
    assert "a\ufffdb" in text
    assert 'aria-label="c\ufffdd"' in text
