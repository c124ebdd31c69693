from __future__ import annotations

import ssl
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import trustme

from dfdbench.building.fetching.transfer import NotThereError, Patience, Transfer, UnreachableError
from dfdbench.errors import SourceError
from tests.site import Site, served

CONTENT = bytes(range(256)) * 4000
QUICK = Patience(tries=4, pause=0.01, silence=0.5)


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    (tmp_path / "site").mkdir()
    (tmp_path / "site/file").write_bytes(CONTENT)
    with served(tmp_path / "site") as site:
        yield site


def transfer(patience: Patience = QUICK) -> Transfer:
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
    Transfer(QUICK, threading.Event(), received.append).receive(
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
    assert len(site.requests) == 3 * QUICK.tries


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
        Transfer(QUICK, stopped, lambda count: None).receive(
            f"{site.address}/file", tmp_path / "part"
        )
    assert site.requests == []
