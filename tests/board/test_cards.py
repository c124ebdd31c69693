"""Cards of methods: what they must say, and that no two share a name or a method."""

from pathlib import Path

import pytest

from dfdbench.board.board import leaderboard
from dfdbench.board.cards import find_card, load_cards
from dfdbench.errors import ResultError
from dfdbench.evaluation.check import load_to_check
from tests.board.made_boards import add, add_card

HERE = Path(__file__).parents[2] / "leaderboard"


def problems(folder: Path) -> list[str]:
    with pytest.raises(ResultError) as caught:
        load_cards(folder)
    return [str(problem).partition("\n")[0] for problem in caught.value.problems]


def test_every_wrong_card_is_named_at_once(tmp_path: Path) -> None:
    add_card(tmp_path, "bare", licence=None)
    add_card(tmp_path, "blank", "blank:predict", licence=" ")
    add_card(tmp_path, "mine", "mine:predict")
    add_card(tmp_path, "Mine", "other:predict")
    add_card(tmp_path, "twin", "mine:predict")
    add_card(tmp_path, "local", "mine:another")
    # One by its name, the other by where it is.
    add_card(tmp_path, "flat", "constant")
    add_card(tmp_path, "flatter", "dfdbench.methods.baselines:Constant")
    add_card(tmp_path, "script", code="https://example.org/><script>")
    add_card(tmp_path, "lines", parameters={"a": "x\n```\n<script>"})
    (tmp_path / "methods/torn.toml").write_text("title = ")
    found = problems(tmp_path)
    folder = tmp_path / "methods"
    assert f"field is missing ({folder}/bare.toml: licence)" in found
    assert any(f"{folder}/blank.toml" in text and "not blank" in text for text in found)
    assert f"two cards of one name ({folder}/Mine.toml, {folder}/mine.toml)" in found
    assert f"two cards of one method ({folder}/mine.toml, {folder}/twin.toml)" in found
    assert f"two cards of one method ({folder}/flat.toml, {folder}/flatter.toml)" in found
    assert any(f"({folder}/script.toml: code)" in text for text in found)
    assert any(f"({folder}/lines.toml)" in text for text in found)
    assert any(text.startswith("the name is that of our own local") for text in found)
    assert any(text.startswith("cannot read the card") for text in found)
    assert len(found) == 9


def test_a_row_needs_the_card_of_its_name(tmp_path: Path) -> None:
    add(tmp_path, "mine", 0.1)
    card = tmp_path / "methods/mine.toml"
    add_card(tmp_path, "mine", "theirs:predict")
    told = "the row is of mine, and the card of its name of another"
    with pytest.raises(ResultError, match=told):
        leaderboard(tmp_path)
    card.unlink()
    with pytest.raises(ResultError) as caught:
        leaderboard(tmp_path)
    assert f"Fix: {card}: write one" in str(caught.value)


def test_our_own_cards_name_methods_that_can_be_loaded() -> None:
    pytest.importorskip("torch", reason="needs the extra nets")
    for card in (card for card in load_cards(HERE).values() if "://" not in card.code):
        method = load_to_check(card.entry, card.parameters)
        assert method.takes_stack == ("pair" not in card.takes)


def test_a_card_is_found_by_entry_and_parameters(tmp_path: Path) -> None:
    add_card(tmp_path, "plain", "local")
    add_card(tmp_path, "wide", "local", parameters={"window": 9})
    entry = "dfdbench.methods.baselines:Local"
    assert find_card(tmp_path, "local", entry, {}) == "plain"
    assert find_card(tmp_path, "local", entry, {"window": 9}) == "wide"
    with pytest.raises(ResultError, match="local window=11 has no card"):
        find_card(tmp_path, "local", entry, {"window": 11})
