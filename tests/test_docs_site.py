"""The documentation site: what is made of the code is whole; it builds without a warning."""

import gzip
import importlib
import inspect
import io
import json
import pkgutil
import re
import shlex
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from selenium.webdriver.common.keys import Keys

import dfdbench.figures
from dfdbench.board.board import Board, leaderboard
from dfdbench.board.ranking import ScoreBoard, boards
from dfdbench.cli import VERBS
from dfdbench.datasets.catalog import find_manifest
from dfdbench.datasets.manifest import Pair
from dfdbench.methods.registry import find_entry
from dfdbench.metrics.metric import IN_METRES
from dfdbench.metrics.protocol import RELEASED
from dfdbench.results.record import PairResult, Result
from tests.board.made_boards import add, entry_of, make_tracks, scored, submit
from tests.made_results import make_demo_result
from tests.report import test_browser

chromium = test_browser.chromium

ROOT = Path(__file__).parents[1]


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Imports a module of the site's own."""
    monkeypatch.syspath_prepend(str(ROOT / "docs/site"))
    return importlib.import_module


def test_every_command_is_told_with_every_option(made: Any) -> None:
    page = made("commands").commands_page()
    sections = dict(re.findall(r"^##+ (dfdbench .+?)\n(.*?)(?=^##|\Z)", page, re.S | re.M))

    def hold(command: Any, name: str) -> None:
        told = re.findall(r"^\| `([^\s`]+)", sections[name], re.M)
        shown = [p for p in command.params if not getattr(p, "hidden", False)]
        asked = [p.opts[-1] if p.opts[0][0] == "-" else p.metavar or p.name for p in shown]
        assert [text.rstrip(".").split("/")[0] for text in told] == asked, name
        for inner in command.list_commands(None) if hasattr(command, "list_commands") else ():
            hold(command.get_command(None, inner), f"{name} {inner}")

    for name, verb in VERBS.items():
        hold(verb.load(name), f"dfdbench {name}")


def test_every_field_of_a_result_is_told(made: Any) -> None:
    page = made("formats").formats_page()
    for title, model in (("## A result", Result), ("### A result: PairResult", PairResult)):
        section = page.partition(f"\n{title}\n")[2].partition("\n#")[0]
        fields = dict(re.findall(r"^\| `(\w+)` \| (.+?) \|", section, re.M))
        assert list(fields) == list(model.model_fields)
    assert fields["status"] == '"ok", "failed", "missing", "not-run"'
    assert fields["warnings"] == "list of string"


@pytest.fixture(scope="module")
def board() -> Board:
    return leaderboard(ROOT / "leaderboard")


def rows_of(page: str) -> Any:
    (text,) = re.findall(r'id="board-data">(.*?)</script>', page, re.S)
    return json.loads(text)["boards"]


@pytest.mark.slow
def test_every_row_of_the_leaderboard_is_there_with_its_file(made: Any, board: Board) -> None:
    page = made("board").board_page(board)
    boards = rows_of(page)
    files = {row["file"] for one in boards for row in one["rows"]}
    assert files == {path.relative_to(board.folder).as_posix() for path in board.rows}
    for one in boards:
        assert all(len(row["scores"]) == len(one["metrics"]) for row in one["rows"])
    demo = next(one for one in boards if one["set"] == "demo-1, split test")
    shown = (ROOT / "leaderboard/README.md").read_text("utf-8")
    first = demo["rows"][0]
    assert f"| 1 | {first['method']} | {first['given']} | {first['scores'][0]:.4f} |" in shown
    # Without scripts the page has a table of each headline ranking.
    before = page.partition("<script")[0]
    assert f"| 1 | {first['method']} | {first['scores'][0]:.4f} | {first['given']} |" in before


def parsed(line: str) -> Any:
    """The context of the command that a line names; words that it does not take raise."""
    _, name, *words = shlex.split(line)
    command: Any = VERBS[name].load(name)
    while hasattr(command, "list_commands"):
        command, words = command.get_command(None, words[0]), words[1:]
    return command.make_context(name, words)


@pytest.mark.slow
def test_the_command_of_each_row_is_one_that_is_accepted(made: Any, board: Board) -> None:
    commands = {
        row["command"]: row
        for one in rows_of(made("board").board_page(board))
        for row in one["rows"]
    }
    for command, row in commands.items():
        context, card = parsed(command), board.cards[row["method"]]
        assert context.params["method"] == card.entry
        assert len(context.params["param"] or ()) == len(card.parameters)
    on_tracks = next(c for c in commands if c.startswith("dfdbench tracks") and c.endswith("local"))
    assert on_tracks == (
        "dfdbench tracks --dataset demo --split test --track=noise --track=psf --track=law "
        "--track=occlusion --track=shift --track=gain --track=camera --method local"
    )


@pytest.mark.slow
def test_the_frame_to_download_is_the_boards(made: Any, board: Board) -> None:
    content = made("board").scores_csv(board)
    assert content == made("board").scores_csv(board)
    text = io.BytesIO(gzip.decompress(content))
    read = pd.read_csv(text, converters={"coordinates": json.loads})
    pd.testing.assert_frame_equal(read, board.scores, check_dtype=False, rtol=1e-15)


@pytest.mark.slow
def test_every_method_has_a_page_with_pictures_parameters_and_rows(made: Any, board: Board) -> None:
    pages = dict(made("cards").method_pages(board))
    assert {Path(place).stem for place in pages} == {"index", *board.cards}
    for name, card in board.cards.items():
        page = pages[f"method/{name}.md"]
        if "://" in card.code:
            continue  # its code is elsewhere, and nobody has drawn it
        for picture in re.findall(r"!\[[^\]]+\]\(\.\./(.+?)\)", page):
            assert (ROOT / "docs" / picture).stat().st_size <= 40_000, picture
        assert f"demo/{name}.jpg" in page
        assert f"[**{name}**]({name}.md)" in pages["method/index.md"]
        rows = [path for path in board.rows if path.stem == name]
        linked = set(re.findall(r"\(\.\./board/(results/.+?)\)", page))
        assert linked == {path.relative_to(board.folder).as_posix() for path in rows}
        place, _, attribute = find_entry(card.entry).partition(":")
        target = getattr(importlib.import_module(place), attribute)
        section = page.partition("## Parameters")[2].partition("\n## ")[0]
        told = dict(re.findall(r"^\| `(\w+)` \| .+? \| (.*) \|$", section, re.M))
        assert list(told) == list(inspect.signature(target).parameters)
        assert all(told.values()), (name, told)
    # Worst first: a network that knows one blur, behind another lens.
    breaks = pages["method/dfd-net-demo.md"].partition("## Where it breaks")[2]
    shares = [float(share) for share in re.findall(r" (\d+\.\d\d) \|$", breaks, re.M)]
    assert (len(shares), shares) == (6, sorted(shares, reverse=True))
    assert shares[0] > 1


@pytest.mark.slow
def test_every_data_set_has_a_page_that_says_whose_it_is(made: Any, board: Board) -> None:
    module = made("datasheets")
    pages = dict(module.dataset_pages(board))
    manifests = module.newest_manifests()
    assert set(pages) == {"datasets/index.md", *(f"datasets/{m.short}.md" for m in manifests)}
    for manifest in manifests:
        page = pages[f"datasets/{manifest.short}.md"]
        for picture in re.findall(r"!\[[^\]]+\]\(\.\./(.+?)\)", page):
            assert (ROOT / "docs" / picture).is_file(), picture
        facts = dict(re.findall(r"^\| ([\w ,()]+) \| (.+) \|$", page, re.M))
        assert facts["licence (license)"]
        assert facts["cite"]
    demo = pages["datasets/demo.md"]
    (known,) = json.loads((board.folder / "fingerprints.json").read_text("utf-8"))["demo-1"]
    assert f"| fingerprint | `{known}` |" in demo
    measured = json.loads((module.PICTURES / "measured.json").read_text("utf-8"))
    assert measured["demo"]["fingerprint"] == known
    assert "## What was measured of it" in demo


def test_the_gallery_holds_every_figure_that_the_package_draws(made: Any) -> None:
    gallery = made("gallery")
    drawn = set()
    for found in pkgutil.iter_modules(dfdbench.figures.__path__):
        module = importlib.import_module(f"dfdbench.figures.{found.name}")
        drawn |= {
            name
            for name, each in inspect.getmembers(module, inspect.isfunction)
            if each.__module__ == module.__name__
            and re.fullmatch(r"[a-z]\w*_figures?|show", name)
            and name != "write_figure"
        }
    shown = [one for figures in gallery.GALLERY.values() for one in figures]
    assert {one.function for one in shown} | gallery.NOT_SHOWN.keys() == drawn
    for one in shown:
        assert one.picture.stat().st_size <= 100_000, one
    page = gallery.gallery_page()
    assert all(one.command in page and f"gallery/{one.picture.name}" in page for one in shown)
    for line in {line for one in shown for line in (*one.before, one.command)}:
        if line.startswith("dfdbench"):
            assert parsed(line).params


def board_of(*results: Result) -> ScoreBoard:
    (board,) = boards([entry_of(result, ROOT) for result in results])
    return board


def by_name(pair: Pair) -> float:
    return 0.01 * len(pair.scene)


def test_a_row_is_the_mean_of_a_scene_and_a_column_a_method(made: Any) -> None:
    worse = make_demo_result(lambda pair: by_name(pair) + 0.1 * pair.at["exposure"], "worse")
    table = made("board").scenes_table(board_of(make_demo_result(by_name, "better"), worse))
    assert table.columns == ("scene", "better", "worse")
    assert table.rows[0] == ("Kitchen", "0.0700", "0.1700")
    assert [row[0] for row in table.rows] == ["Kitchen", "Library", "Market"]
    assert table.records[0]["worse"] == pytest.approx(0.17)


def test_folds_are_those_that_the_split_holds_whole(made: Any) -> None:
    def score(pair: Pair) -> float:
        return by_name(pair) + 0.1 * pair.at["view"]

    manifest = find_manifest("middlebury-default")
    whole = make_demo_result(score, dataset="middlebury-default", split="all")
    table = made("board").scenes_table(board_of(whole), folds=True)
    assert [row[0] for row in table.rows] == [fold.name for fold in manifest.folds]
    for fold, record in zip(manifest.folds, table.records, strict=True):
        expected = sum(0.01 * len(scene) for scene in fold.test_scenes) / len(fold.test_scenes)
        assert record["mine"] == pytest.approx(expected + 0.3)


def test_a_row_on_tracks_says_what_its_runs_on_tracks_were_given(made: Any, tmp_path: Path) -> None:
    runs = make_tracks("mine", uses=["recipe"])
    for label in runs.keys() - {"clean"}:
        fitted = {"uses": [], "fitted_on": f"demo-1@{label}, split train"}
        method = runs[label].method.model_copy(update=fitted)
        pairs = [pair.model_copy(update={"seconds": 2.0}) for pair in runs[label].pairs]
        runs[label] = runs[label].model_copy(update={"method": method, "pairs": pairs})
    submit(list(runs.values()), tmp_path)
    (row,) = [
        row
        for one in rows_of(made("board").board_page(leaderboard(tmp_path)))
        for row in one["rows"]
    ]
    assert (row["given"], row["seconds"]) == ("training pairs", 2.0)


def test_what_only_some_rows_need_is_explained_if_there_are_such_rows(
    made: Any, tmp_path: Path
) -> None:
    module = made("board")
    add(tmp_path, "mine", 0.1)
    text = dict(module.board_files(leaderboard(tmp_path)))["board/demo-1-test.md"]
    for words in (module.TRACKS_NOTE, module.SCORED_NOTE):
        assert words not in text
    result = make_demo_result(lambda pair: 0.1, "far")
    metres = dict.fromkeys(IN_METRES, 0.25)
    pairs = [
        pair.model_copy(update={"scores": pair.scores | {"metric": metres}})
        for pair in result.pairs
    ]
    protocols = [*result.protocols, RELEASED["metric"].as_dict()]
    submit(result.model_copy(update={"pairs": pairs, "protocols": protocols}), tmp_path)
    submit(list(make_tracks("tracked").values()), tmp_path)
    submit(scored("elsewhere", 0.01), tmp_path)
    text = dict(module.board_files(leaderboard(tmp_path)))["board/demo-1-test.md"]
    assert module.TRACKS_NOTE in text
    ranked, below = text.split(module.SCORED_NOTE, 1)
    assert "elsewhere" not in ranked.partition("---\n\n")[2]
    assert "[elsewhere](results/" in below


def test_links_lead_where_the_site_has_what_they_name(made: Any) -> None:
    pytest.importorskip("mkdocs", reason="needs the extra docs")
    relinked = made("links").relinked
    text = "[a](../CONTRIBUTING.md#b) [c](../leaderboard/README.md) [d](tracks.md) [e](#f)"
    assert relinked(text, "docs/x.md", "x.md") == (
        "[a](contributing.md#b) [c](board/index.md) [d](tracks.md) [e](#f)"
    )
    text = "[a](results/x/y.json) [b](../docs/metres.md) [c](https://example.org/a.md)"
    assert relinked(text, "leaderboard/README.md", "board/tables.md") == (
        "[a](results/x/y.json) [b](../metres.md) [c](https://example.org/a.md)"
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs", reason="needs the extra docs")
    from mkdocs.commands.build import build
    from mkdocs.config import load_config

    place = tmp_path_factory.mktemp("site")
    config = load_config(str(ROOT / "mkdocs.yml"), site_dir=str(place), strict=True)
    config.plugins.on_startup(command="build", dirty=False)
    build(config)
    return place


#: What a newcomer asks, where the answer stands, and words of it.
QUESTIONS = {
    "which protocol did the thesis use": ("which-protocol-did-the-thesis-use", "thesis-networks"),
    "own photographs": ("how-do-i-use-my-own-photographs", "new-dataset"),
    "what does given mean": ("what-does-given-mean", "blur fitted"),
    "how do I cite": ("how-do-i-cite", "CITATION.cff"),
    "weights trained on": ("what-were-the-shipped-weights-trained-on", "middlebury-default"),
    "status 2": ("what-does-status-2-mean", "--allow-missing"),
}


@pytest.mark.slow
def test_every_page_is_described_small_and_asks_no_other_server(site: Path) -> None:
    listed = (site / "llms.txt").read_text("utf-8")
    assert listed.startswith("# dfdbench\n")
    for page in site.rglob("*.html"):
        place = page.relative_to(site)
        html = page.read_text("utf-8")
        fetched = re.findall(r'<(?:script|img|link)[^>]+(?:src|href)="(https?:[^"]+)"', html)
        assert not fetched, place
        (description,) = re.findall(r'<meta name="description" content="([^"]+)"', html)
        assert 20 < len(description) <= 200, place
        assert len(html) < 300_000 or place.parts[0] == "board", place
    for name in ("method/local/", "datasets/demo/", "board/", "reference/commands/"):
        (line,) = re.findall(rf"\]\({name}\): (.+)", listed)
        assert line
    found = json.loads((site / "search/search_index.json").read_text("utf-8"))["docs"]
    answers = {entry["location"]: entry["text"] for entry in found}
    for anchor, words in QUESTIONS.values():
        assert words in re.sub(r"<[^>]+>", "", answers[f"questions/#{anchor}"])
    about = [entry["location"] for entry in found if "license" in entry["text"]]
    assert {"licence/", "datasets/", "datasets/demo/"} <= set(about)


@pytest.mark.slow
def test_pages_have_the_addresses_that_the_package_names(
    made: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    config_module = pytest.importorskip("mkdocs.config", reason="needs the extra docs")
    hooks = made("hooks")
    named = {"project": {"urls": {"Documentation": "https://example.org/dfdbench"}}}
    monkeypatch.setattr(hooks.tomllib, "loads", lambda text: named)
    monkeypatch.setattr(hooks, "load_cards", lambda folder: {"mine": None})
    config = hooks.on_config(config_module.load_config(str(ROOT / "mkdocs.yml")))
    assert config.site_url == "https://example.org/dfdbench/"
    (methods,) = [section["Methods"] for section in config.nav if "Methods" in section]
    assert methods[methods.index("method/index.md") + 1] == "method/mine.md"


def column(page: Any, number: int) -> list[str]:
    cells = page.find_elements("css selector", f"#board tbody td:nth-child({number})")
    return [cell.text.removesuffix("\nhow") for cell in cells]


@pytest.mark.slow
def test_the_leaderboard_sorts_and_filters(site: Path, chromium: Any) -> None:
    chromium.get((site / "board/index.html").as_uri() + "?set=demo-1, split test")
    ranks = [int(rank) for rank in column(chromium, 1)]
    assert ranks == sorted(ranks)
    ranked = column(chromium, 2)
    assert chromium.find_element("css selector", "#board th:nth-child(3)").text == "NRMSE ↓"
    seconds = chromium.find_element("css selector", "#board th:nth-child(7) button")
    assert seconds.text == "seconds per pair"
    seconds.click()
    assert (column(chromium, 2)[0], sorted(column(chromium, 2))) == ("constant", sorted(ranked))
    chromium.find_element("css selector", "#board input").send_keys("graph")
    shown = column(chromium, 2)
    assert shown == [name for name in shown if "graph" in name]
    for link in chromium.find_elements("css selector", "#board tbody a"):
        place = Path(link.get_attribute("href").removeprefix("file://"))
        assert place.is_file() or (place / "index.html").is_file()
    marks = chromium.find_elements("css selector", ".board-plot circle")
    assert len(marks) == len(shown)
    # Search needs a server: from a file it finds no index.
    assert [said for said in test_browser.complaints(chromium) if "search" not in said] == []

    # The address shows the same to whoever opens it.
    address = chromium.current_url
    chromium.get("about:blank")
    chromium.get(address)
    assert column(chromium, 2) == shown
    ordered = chromium.find_element("css selector", "#board th:nth-child(7)")
    assert ordered.get_attribute("aria-sort") == "ascending"


@pytest.mark.slow
def test_depth_maps_lie_on_each_other_under_a_slider(site: Path, chromium: Any) -> None:
    chromium.get(
        (site / "board/index.html").as_uri() + "?set=demo-1, split test&left=local&right=constant"
    )
    under, over = chromium.find_elements("css selector", ".board-pictures img")
    assert under.get_attribute("src").endswith("/constant.jpg")
    assert over.get_attribute("alt") == "Kitchen of the demo set: local"
    assert test_browser.ask(chromium, "arguments[0].naturalWidth", over) == 320
    before = over.value_of_css_property("clip-path")
    slider = chromium.find_element("css selector", ".board-maps input")
    slider.send_keys(Keys.ARROW_RIGHT)
    assert over.value_of_css_property("clip-path") != before


#: A page of each kind.
KINDS = (
    "index.html",
    "tutorial/index.html",
    "method/index.html",
    "method/graph-cuts/index.html",
    "datasets/index.html",
    "datasets/demo/index.html",
    "gallery/index.html",
    "board/index.html",
    "board/demo-1-test/index.html",
    "reference/commands/index.html",
)


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
def test_no_page_is_wider_than_its_window(site: Path, chromium: Any, width: int) -> None:
    size = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": width < 500}
    chromium.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    for place in KINDS:
        chromium.get((site / place).as_uri())
        assert test_browser.ask(chromium, "document.documentElement.scrollWidth") <= width, place
        unnamed = "[...document.images].filter(image => !image.alt.trim()).length"
        assert test_browser.ask(chromium, unnamed) == 0, place
        if place == "board/index.html":
            score = chromium.find_element("css selector", "#board tbody td:nth-child(3)")
            assert score.rect["x"] + score.rect["width"] <= width
    chromium.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
