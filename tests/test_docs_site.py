"""The documentation site: what is made of the code is whole; it builds without a warning."""

import importlib
import json
import re
from pathlib import Path
from typing import Any

import pytest

from dfdbench.cli import VERBS
from dfdbench.results.record import PairResult, Result
from tests.board.made_boards import submit
from tests.board.made_tracks import make_tracks
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


@pytest.mark.slow
def test_every_row_of_the_leaderboard_is_there_with_its_file(made: Any) -> None:
    page = made("board").board_page(ROOT / "leaderboard")
    (text,) = re.findall(r'id="board-data">(.*?)</script>', page, re.S)
    boards = json.loads(text)
    files = {row["file"] for board in boards for row in board["rows"]}
    assert all((ROOT / "leaderboard" / name).is_file() for name in files)
    results = {
        path.relative_to(ROOT / "leaderboard").as_posix()
        for path in (ROOT / "leaderboard/results").rglob("*.json")
    }
    assert files == results
    for board in boards:
        assert all(len(row["scores"]) == len(board["metrics"]) for row in board["rows"])
    demo = next(b for b in boards if (b["set"], b["protocol"]) == ("demo-1, split test", "thesis"))
    shown = (ROOT / "leaderboard/README.md").read_text("utf-8")
    first = demo["rows"][0]
    assert f"| 1 | {first['method']} | {first['given']} | {first['scores'][0]:.4f} |" in shown


def test_a_row_on_tracks_says_what_its_runs_on_tracks_were_given(made: Any, tmp_path: Path) -> None:
    runs = make_tracks("mine", uses=["recipe"])
    for label in runs.keys() - {"clean"}:
        fitted = {"uses": [], "fitted_on": f"demo-1@{label}, split train"}
        method = runs[label].method.model_copy(update=fitted)
        pairs = [pair.model_copy(update={"seconds": 2.0}) for pair in runs[label].pairs]
        runs[label] = runs[label].model_copy(update={"method": method, "pairs": pairs})
    submit(list(runs.values()), tmp_path)
    (text,) = re.findall(r'id="board-data">(.*?)</script>', made("board").board_page(tmp_path))
    (row,) = [row for board in json.loads(text) for row in board["rows"]]
    assert (row["given"], row["seconds"]) == ("blur fitted", 2.0)


def test_links_lead_where_the_site_has_what_they_name(made: Any) -> None:
    pytest.importorskip("mkdocs", reason="needs the extra docs")
    relinked = made("hooks")._relinked
    text = "[a](../CONTRIBUTING.md#b) [c](../leaderboard/README.md) [d](tracks.md) [e](#f)"
    assert relinked(text, "docs/x.md", "x.md") == (
        "[a](contributing.md#b) [c](board/tables.md) [d](tracks.md) [e](#f)"
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
def test_the_site_asks_no_other_server_and_answers_what_newcomers_ask(site: Path) -> None:
    for page in site.rglob("*.html"):
        html = page.read_text("utf-8")
        fetched = re.findall(r'<(?:script|img|link)[^>]+(?:src|href)="(https?:[^"]+)"', html)
        assert not fetched, page
    found = json.loads((site / "search/search_index.json").read_text("utf-8"))["docs"]
    answers = {entry["location"]: entry["text"] for entry in found}
    for anchor, words in QUESTIONS.values():
        assert words in re.sub(r"<[^>]+>", "", answers[f"questions/#{anchor}"])


@pytest.mark.slow
def test_the_leaderboard_sorts_and_filters(site: Path, chromium: Any) -> None:
    chromium.get((site / "board/index.html").as_uri())
    choose = (
        "const [set, protocol] = document.querySelectorAll('#board select');"
        "set.value = 'demo-1, split test'; set.dispatchEvent(new Event('change'));"
    )
    chromium.execute_script(choose)

    def column(number: int) -> list[str]:
        cells = f"#board tbody td:nth-child({number})"
        return [cell.text for cell in chromium.find_elements("css selector", cells)]

    assert column(1) == sorted(column(1), key=int)
    ranked = column(2)
    seconds = chromium.find_element("css selector", "#board th:nth-child(7) button")
    assert seconds.text == "seconds per pair"
    seconds.click()
    assert column(2)[0] == "constant"
    assert sorted(column(2)) == sorted(ranked)
    chromium.find_element("css selector", "#board input").send_keys("graph")
    assert column(2) == [name for name in column(2) if "graph" in name]
    link = chromium.find_element("css selector", "#board tbody a").get_attribute("href")
    assert Path(link.removeprefix("file://")).is_file()
    marks = chromium.find_elements("css selector", ".board-plot circle")
    assert len(marks) == len(column(2))
    # Search needs a server: from a file it finds no index.
    assert [said for said in test_browser.complaints(chromium) if "search" not in said] == []
