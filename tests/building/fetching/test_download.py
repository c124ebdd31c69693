from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dfdbench.building.fetching.checksums import check_checksum, sha256
from dfdbench.building.fetching.download import Fate, WantedFile, fetch
from dfdbench.building.fetching.transfer import Patience
from tests.site import Site, served

QUICK = Patience(tries=2, pause=0.01, silence=0.5)
FILES = {f"Art/{number}": bytes([number]) * 5000 for number in range(8)}
KNOWN = {name: sha256(content) for name, content in FILES.items()}


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    for name, content in FILES.items():
        (tmp_path / "site" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "site" / name).write_bytes(content)
    with served(tmp_path / "site") as site:
        yield site


def wanted(*addresses: str) -> list[WantedFile]:
    def check(name: str, path: Path, where: str) -> None:
        check_checksum(name, path.read_bytes(), KNOWN, where)

    return [
        WantedFile(
            name,
            tuple(f"{address}/{name}" for address in addresses),
            lambda path, where, name=name: check(name, path, where),  # type: ignore[misc]
        )
        for name in FILES
    ]


def kinds(fates: tuple[Fate, ...]) -> dict[str, str]:
    return {fate.name: fate.kind for fate in fates}


def test_all_files_come_and_are_kept(site: Site, tmp_path: Path) -> None:
    steps: list[tuple[int, int, int]] = []
    fates = fetch(wanted(site.address), tmp_path / "out", lambda *step: steps.append(step), QUICK)
    assert [fate.name for fate in fates] == list(FILES)
    assert set(kinds(fates).values()) == {"new"}
    assert {name: (tmp_path / "out" / name).read_bytes() for name in FILES} == FILES
    assert steps[-1] == (8, 8, 40_000)
    assert not list((tmp_path / "out").rglob("*.part*"))
    asked = len(site.requests)
    again = fetch(wanted(site.address), tmp_path / "out", None, QUICK)
    assert set(kinds(again).values()) == {"kept"}
    assert len(site.requests) == asked


def test_a_bad_file_is_set_aside_and_fetched_once_more(site: Site, tmp_path: Path) -> None:
    site.faults["/Art/1"] = ["wrong"]
    site.faults["/Art/2"] = ["wrong", "wrong"]
    fates = fetch(wanted(site.address), tmp_path / "out", None, QUICK)
    assert kinds(fates)["Art/1"] == "new"
    assert kinds(fates)["Art/2"] == "damaged"
    assert len(site.asked_for("/Art/1")) == len(site.asked_for("/Art/2")) == 2
    aside = [path.name[:2] for path in sorted((tmp_path / "out/set-aside/Art").iterdir())]
    assert aside == ["1.", "2."]
    assert not (tmp_path / "out/Art/2").exists()


def test_a_file_damaged_on_disk_is_replaced(site: Site, tmp_path: Path) -> None:
    fetch(wanted(site.address), tmp_path / "out", None, QUICK)
    (tmp_path / "out/Art/3").write_bytes(b"rot")
    offline = fetch(wanted(), tmp_path / "out", None, QUICK, offline=True)
    assert kinds(offline)["Art/3"] == "damaged"
    assert "SHA-256" in str(offline[3].problems[0])
    assert [path.read_bytes() for path in (tmp_path / "out/set-aside/Art").iterdir()] == [b"rot"]
    assert kinds(fetch(wanted(), tmp_path / "out", offline=True))["Art/3"] == "missing"
    online = fetch(wanted(site.address), tmp_path / "out", None, QUICK)
    assert kinds(online)["Art/3"] == "new"
    assert (tmp_path / "out/Art/3").read_bytes() == FILES["Art/3"]


def test_missing_and_unreachable_are_told_apart(site: Site, tmp_path: Path) -> None:
    (site.folder / "Art/4").unlink()
    site.faults["/Art/5"] = ["500"] * 9
    fates = fetch(wanted(site.address), tmp_path / "out", None, QUICK)
    assert kinds(fates)["Art/4"] == "missing"
    assert kinds(fates)["Art/5"] == "unreachable"
    assert "500" in str(fates[5].problems[0])


def test_mirrors_are_asked_in_their_order(site: Site, tmp_path: Path) -> None:
    mirror = tmp_path / "mirror"
    (mirror / "Art").mkdir(parents=True)
    for name in list(FILES)[:4]:
        (mirror / name).write_bytes(FILES[name])
    (mirror / "Art/0").write_bytes(b"another version")
    with served(mirror) as first:
        fates = fetch(wanted(first.address, site.address), tmp_path / "out", None, QUICK)
    assert set(kinds(fates).values()) == {"new"}
    # The mirror's bad file came from the site instead; the mirror was not asked for it twice.
    assert len(first.asked_for("/Art/0")) == len(site.asked_for("/Art/0")) == 1
    assert [len(site.asked_for(f"/Art/{number}")) for number in range(8)] == [
        1,
        0,
        0,
        0,
        1,
        1,
        1,
        1,
    ]


def test_a_server_that_is_gone_costs_no_hours(tmp_path: Path) -> None:
    fates = fetch(wanted("http://127.0.0.1:9"), tmp_path / "out", None, QUICK)
    assert set(kinds(fates).values()) == {"unreachable"}
    assert any("given up" in str(fate.problems[0]) for fate in fates)
