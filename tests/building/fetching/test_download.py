from __future__ import annotations

import ssl
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import trustme

from dfdbench.building.fetching.checksums import check_checksum, sha256
from dfdbench.building.fetching.download import (
    Fate,
    NotThereError,
    Patience,
    Transfer,
    UnreachableError,
    WantedFile,
    fetch,
)
from dfdbench.errors import SourceError
from tests.site import Site, served

QUICK = Patience(tries=2, pause=0.01, silence=0.5)
FILES = {f"Art/{number}": bytes([number]) * 5000 for number in range(8)}
CONTENT = bytes(range(256)) * 4000
PATIENT = Patience(tries=4, pause=0.01, silence=0.5)
KNOWN = {name: sha256(content) for name, content in FILES.items()}


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    for name, content in FILES.items():
        (tmp_path / "site" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "site" / name).write_bytes(content)
    (tmp_path / "site/file").write_bytes(CONTENT)
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


def transfer(patience: Patience = PATIENT) -> Transfer:
    return Transfer(patience, threading.Event(), lambda count: None)


@pytest.mark.parametrize(
    "faults",
    [
        [],
        ["500", "503"],
        ["429"],
        ["truncate", "truncate"],
        ["stall"],
        ["redirect"],
        ["truncate", "500", "redirect"],
    ],
)
def test_a_file_comes_whole_in_the_end(site: Site, tmp_path: Path, faults: list[str]) -> None:
    site.faults["/file"] = list(faults)
    received: list[int] = []
    Transfer(PATIENT, threading.Event(), received.append).receive(
        f"{site.address}/file", tmp_path / "file.part"
    )
    assert (tmp_path / "file.part").read_bytes() == CONTENT
    # What came before a failure is not asked for again.
    assert sum(received) == len(CONTENT)


def test_the_rest_is_asked_for_by_a_later_call(site: Site, tmp_path: Path) -> None:
    part = tmp_path / "file.part"
    site.faults["/file"] = ["truncate"]
    with pytest.raises(UnreachableError):
        transfer(Patience(tries=1)).receive(f"{site.address}/file", part)
    have = part.stat().st_size
    assert 0 < have < len(CONTENT)
    transfer().receive(f"{site.address}/file", part)
    assert part.read_bytes() == CONTENT
    assert site.asked_for("/file") == ["", f"bytes={have}-"]


def test_a_file_that_changed_meanwhile_is_fetched_from_its_start(
    site: Site, tmp_path: Path
) -> None:
    part = tmp_path / "file.part"
    site.faults["/file"] = ["truncate"]
    with pytest.raises(UnreachableError):
        transfer(Patience(tries=1)).receive(f"{site.address}/file", part)
    (site.folder / "file").write_bytes(CONTENT[::-1])
    transfer().receive(f"{site.address}/file", part)
    assert part.read_bytes() == CONTENT[::-1]


def test_a_part_that_is_too_long_is_dropped(site: Site, tmp_path: Path) -> None:
    part = tmp_path / "file.part"
    site.faults["/file"] = ["truncate"]
    with pytest.raises(UnreachableError):
        transfer(Patience(tries=1)).receive(f"{site.address}/file", part)
    part.write_bytes(CONTENT + b"more")
    transfer().receive(f"{site.address}/file", part)
    assert part.read_bytes() == CONTENT


@pytest.mark.parametrize("status", ["404", "410", "403"])
def test_what_is_not_there_is_not_asked_for_twice(site: Site, tmp_path: Path, status: str) -> None:
    site.faults["/file"] = [status]
    with pytest.raises(NotThereError):
        transfer().receive(f"{site.address}/file", tmp_path / "part")
    assert len(site.requests) == 1


def test_a_server_that_fails_for_ever(site: Site, tmp_path: Path) -> None:
    site.faults["/file"] = ["500"] * 99
    one = transfer()
    for number in range(5):
        with pytest.raises(UnreachableError, match="500" if number < 3 else "given up"):
            one.receive(f"{site.address}/file", tmp_path / "part")
    # After three files in a row it is not asked any more.
    assert len(site.requests) == 3 * PATIENT.tries


@pytest.mark.parametrize(
    ("address", "told"),
    [
        ("http://127.0.0.1:9/file", "Connection refused"),
        ("ftp://127.0.0.1/file", "not an address"),
        ("nonsense", "not an address"),
        ("http://[1/file", "not an address"),
    ],
)
def test_addresses_that_lead_nowhere(tmp_path: Path, address: str, told: str) -> None:
    with pytest.raises(UnreachableError, match=told):
        transfer().receive(address, tmp_path / "part")


def test_a_proxy_that_is_not_there(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:9")
    monkeypatch.delenv("NO_PROXY", raising=False)
    monkeypatch.delenv("no_proxy", raising=False)
    with pytest.raises(UnreachableError, match="proxy"):
        transfer().receive("http://example.invalid/file", tmp_path / "part")


def test_a_certificate_nobody_vouches_for_is_refused_and_a_bundle_mends_it(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    authority = trustme.CA()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert("localhost").configure_cert(context)
    with served(site.folder, context) as secure:
        with pytest.raises(UnreachableError, match="localhost cannot be verified") as caught:
            transfer().receive(f"{secure.address}/file", tmp_path / "part")
        assert "REQUESTS_CA_BUNDLE" in str(caught.value)
        authority.cert_pem.write_to_path(str(tmp_path / "bundle.pem"))
        monkeypatch.setenv("REQUESTS_CA_BUNDLE", str(tmp_path / "bundle.pem"))
        transfer().receive(f"{secure.address}/file", tmp_path / "part")
    assert (tmp_path / "part").read_bytes() == CONTENT


def test_a_disk_that_is_full(site: Site, tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full on this system")
    (tmp_path / "part").symlink_to("/dev/full")
    with pytest.raises(SourceError, match="cannot keep the download"):
        transfer().receive(f"{site.address}/file", tmp_path / "part")


def test_after_a_stop_nothing_is_asked_for(site: Site, tmp_path: Path) -> None:
    stopped = threading.Event()
    stopped.set()
    with pytest.raises(UnreachableError, match="stopped"):
        Transfer(PATIENT, stopped, lambda count: None).receive(
            f"{site.address}/file", tmp_path / "part"
        )
    assert site.requests == []
