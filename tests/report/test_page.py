import json
import re
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

from dfdbench.errors import UnknownNameError
from dfdbench.report import page
from dfdbench.results.record import Result, average
from dfdbench.results.saved_run import SavedRun
from tests.made_results import edited, limited, make_result, saved
from tests.report.conftest import HOSTILE
from tests.system.test_thumbnails import decoded

PAIRS = {("k00", 1, 1, 0): 0.4, ("k00", 1, 1, 1): 0.2, ("k01", 1, 1, 0): 0.1}


def gathered(folder: Path, *results: Result, protocol: str = "thesis") -> page.Content:
    return page.gather(saved(folder, *results), protocol, folder)


def test_runs_of_one_data_set_are_one_section_best_first(tmp_path: Path) -> None:
    worse = {place: 2 * nrmse for place, nrmse in PAIRS.items()}
    content = gathered(tmp_path, make_result(worse, "worse"), make_result(PAIRS, "better"))
    (section,) = content.sections
    assert content.methods == ("better", "worse")
    assert [label for label, _ in section.details] == ["better", "worse"]
    assert content.title == "Depth from defocus: 2 methods"
    assert "best of 2: better, NRMSE 0.2333" in content.summary[0]
    assert content.missing == ("better: no depth maps", "worse: no depth maps")


def test_the_first_sentence_names_the_best_of_the_runs_that_have_a_mean(tmp_path: Path) -> None:
    perfect = make_result(dict.fromkeys(PAIRS, 0.0), "perfect")
    none = dict.fromkeys(("nrmse", "nmae", "ssim"))
    gaps = edited(make_result(PAIRS, "gaps"), pairs={"answered": 0.5, "scores": {"thesis": none}})
    gaps = edited(gaps, averages=average(gaps.pairs, ["thesis"]))
    where = "tiny-1, split test, protocol thesis"
    (told,) = gathered(tmp_path, gaps, perfect).summary
    assert told == f"{where}: perfect, NRMSE 0.0000, NMAE 0.0000, SSIM 1.0000."
    (told,) = gathered(tmp_path, gaps, limited(perfect, 1)).summary
    assert told == f"{where}: no run has a mean NRMSE."


def test_links_to_scored_depth_maps_lead_there_from_the_report(tmp_path: Path) -> None:
    theirs = edited(make_result(PAIRS, "theirs"), method={"scored": "levels"})
    runs = saved(tmp_path, theirs)
    text = page.write_markdown(runs, "thesis", tmp_path / "report").read_text("utf-8")
    assert "[theirs (scored, not run)](../0.json)" in text


def test_other_data_are_another_section(tmp_path: Path) -> None:
    here = make_result(PAIRS)
    moved = here.dataset.model_copy(update={"fingerprint": "3" * 64})
    content = gathered(tmp_path, here, here.model_copy(update={"dataset": moved}))
    assert [section.fingerprint[0] for section in content.sections] == ["2", "3"]
    with pytest.raises(UnknownNameError, match="valid"):
        gathered(tmp_path, here, protocol="valid")
    other = make_result(PAIRS, "other").model_dump_json().replace('"thesis"', '"own"')
    content = gathered(tmp_path, here, Result.model_validate_json(other))
    assert (content.methods, content.summary[0]) == (("mine",), "other: not scored under thesis.")


def test_a_limited_run_has_no_empty_table(tmp_path: Path) -> None:
    ((_, tables),) = gathered(tmp_path, limited(make_result(PAIRS), 2)).sections[0].details
    assert tables
    assert all(table.rows for table in tables)
    assert not any("spread" in table.title for table in tables)
    ((_, tables),) = gathered(tmp_path, make_result(PAIRS)).sections[0].details
    assert any("spread" in table.title for table in tables)


Found = list[tuple[str, dict[str, str | None]]]


@pytest.fixture(scope="module")
def tags(html_page: Path) -> Found:
    found: Found = []
    parser = HTMLParser()
    parser.handle_starttag = lambda tag, attrs: found.append((tag, dict(attrs)))  # type: ignore[method-assign]
    parser.feed(html_page.read_text("utf-8"))
    return found


def test_nothing_is_fetched(tags: Found) -> None:
    for tag, attributes in tags:
        for name in ("src", "href", "xlink:href", "action", "srcset"):
            value = attributes.get(name) or "#"
            assert value.startswith(("#", "data:")), (tag, name, value)
    policies = [a for t, a in tags if t == "meta" and "content-security" in str(a).lower()]
    assert "default-src 'none'" in str(policies)


def test_a_name_is_no_markup(html_page: Path, tags: Found) -> None:
    assert HOSTILE not in html_page.read_text("utf-8")
    assert not [t for t, a in tags if "onerror" in a]
    assert HOSTILE in [a["value"] for t, a in tags if t == "option" and a.get("value")]


def test_each_pair_has_its_pictures_each_once(html_page: Path, tags: Found) -> None:
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


def test_unknown_depth_is_grey_and_no_error_is_white() -> None:
    depth = np.full((32, 32), 50.0)
    depth[:, :16] = np.nan
    shown = decoded(page.depth_picture(depth, {"cmap": "viridis", "vmin": 0, "vmax": 100}))
    assert shown[16, 4] == pytest.approx(191, abs=8)
    error = {"cmap": "PuOr", "vmin": -50, "vmax": 50}
    assert (decoded(page.depth_picture(np.zeros((32, 32)), error))[16, 16] > 235).all()


def test_a_figure_is_one_svg_element_named_for_who_cannot_see_it() -> None:
    figure = Figure()
    figure.subplots().set_title("a < b\x00c\x1bd\ufffee")
    text = page.inline_svg(figure, 'n "q" <x>\x1b')
    assert text.startswith("<svg")
    # What SVG cannot hold is shown as replaced.
    assert 'aria-label="n &quot;q&quot; &lt;x&gt;\ufffd"' in text
    assert "a &lt; b\ufffdc\ufffdd\ufffde" in text


@pytest.mark.slow
def test_it_says_the_same_beside_pictures(saved_runs: list[SavedRun], tmp_path: Path) -> None:
    text = page.write_markdown(saved_runs, "thesis", tmp_path).read_text("utf-8")
    pictures = re.findall(r"^!\[.*\]\((.*?)\)$", text, re.M)
    # The scene's lightings, the times, accuracy against them, and each method's worst pairs.
    assert len(pictures) == 5
    for name in pictures:
        assert cv2.imread(str(tmp_path / name)) is not None
    assert "<img" not in text
    assert "constant" in text
    assert text.count("**best and worst pairs, protocol thesis**") == 2
