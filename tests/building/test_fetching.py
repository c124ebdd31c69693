import ssl
import struct
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import trustme

from dfdbench.building import fetching
from dfdbench.datasets.manifest import Manifest
from dfdbench.errors import SourceError
from tests.site import Site, served

FILES = {f"Art/{number}": bytes([number]) * 5000 for number in range(8)}
CONTENT = bytes(range(256)) * 4000
KNOWN = {name: fetching.sha256(content) for name, content in FILES.items()}


pytestmark = pytest.mark.usefixtures("impatient")


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    for name, content in FILES.items():
        (tmp_path / "site" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "site" / name).write_bytes(content)
    (tmp_path / "site/file").write_bytes(CONTENT)
    with served(tmp_path / "site") as site:
        yield site


def fetch(wanted: list[fetching.WantedFile], folder: Path, **options: Any) -> list[fetching.Fate]:
    return fetching.Fetcher(folder, **options).bring(wanted)


def wanted(*addresses: str) -> list[fetching.WantedFile]:
    def file(name: str) -> fetching.WantedFile:
        def check(path: Path, where: str) -> None:
            fetching.check_checksum(name, path.read_bytes(), KNOWN, where)

        return fetching.WantedFile(name, tuple(f"{each}/{name}" for each in addresses), check)

    return [file(name) for name in FILES]


def kinds(fates: list[fetching.Fate]) -> dict[str, str]:
    return {fate.name: fate.kind for fate in fates}


def test_a_bad_file_is_set_aside_and_fetched_once_more(site: Site, tmp_path: Path) -> None:
    site.faults["/Art/1"] = ["wrong"]
    site.faults["/Art/2"] = ["wrong", "wrong"]
    fates = fetch(wanted(site.address), tmp_path / "out")
    assert (kinds(fates)["Art/1"], kinds(fates)["Art/2"]) == ("new", "damaged")
    assert site.asked_for("/Art/1") == site.asked_for("/Art/2") == 2
    aside = [path.name[:2] for path in sorted((tmp_path / "out/set-aside/Art").iterdir())]
    assert aside == ["1.", "2."]
    assert not (tmp_path / "out/Art/2").exists()


def test_a_file_damaged_on_disk_is_replaced(site: Site, tmp_path: Path) -> None:
    fetch(wanted(site.address), tmp_path / "out")
    (tmp_path / "out/Art/3").write_bytes(b"rot")
    offline = fetch(wanted(), tmp_path / "out", offline=True)
    assert kinds(offline)["Art/3"] == "damaged"
    assert "SHA-256" in str(offline[3].problems[0])
    assert [path.read_bytes() for path in (tmp_path / "out/set-aside/Art").iterdir()] == [b"rot"]
    assert kinds(fetch(wanted(), tmp_path / "out", offline=True))["Art/3"] == "missing"
    assert kinds(fetch(wanted(site.address), tmp_path / "out"))["Art/3"] == "new"
    assert (tmp_path / "out/Art/3").read_bytes() == FILES["Art/3"]


def test_mirrors_are_asked_in_their_order(site: Site, tmp_path: Path) -> None:
    mirror = tmp_path / "mirror"
    (mirror / "Art").mkdir(parents=True)
    for name in list(FILES)[:4]:
        (mirror / name).write_bytes(FILES[name])
    (mirror / "Art/0").write_bytes(b"another version")
    steps: list[tuple[int, int, int]] = []
    with served(mirror) as first:
        files = wanted(first.address, site.address)
        fates = fetch(files, tmp_path / "out", on_progress=lambda *step: steps.append(step))
    assert set(kinds(fates).values()) == {"new"}
    assert {name: (tmp_path / "out" / name).read_bytes() for name in FILES} == FILES
    assert steps[-1][:2] == (8, 8)
    # The mirror's bad file came from the site instead; the mirror was not asked for it twice.
    assert first.asked_for("/Art/0") == site.asked_for("/Art/0") == 1
    asked = [site.asked_for(f"/Art/{number}") for number in range(8)]
    assert asked == [1, 0, 0, 0, 1, 1, 1, 1]


def test_a_server_that_is_gone_costs_no_hours(tmp_path: Path) -> None:
    fates = fetch(wanted("http://127.0.0.1:9"), tmp_path / "out")
    assert set(kinds(fates).values()) == {"unreachable"}
    assert any("Connection refused" in str(fate.problems[0]) for fate in fates)
    assert any("given up" in str(fate.problems[0]) for fate in fates)


def fetched(address: str, folder: Path) -> fetching.Fate:
    return fetch([fetching.WantedFile("file", (address,), lambda *_: None)], folder)[0]


@pytest.mark.parametrize("faults", [["429"], ["stall"], ["truncate", "500", "redirect"]])
def test_a_file_comes_whole_in_the_end(site: Site, tmp_path: Path, faults: list[str]) -> None:
    site.faults["/file"] = list(faults)
    assert fetched(f"{site.address}/file", tmp_path).kind == "new"
    assert (tmp_path / "file").read_bytes() == CONTENT


@pytest.mark.parametrize("status", ["404", "403"])
def test_what_is_not_there_is_not_asked_for_twice(site: Site, tmp_path: Path, status: str) -> None:
    site.faults["/file"] = [status]
    assert fetched(f"{site.address}/file", tmp_path).kind == "missing"
    assert len(site.requests) == 1


@pytest.mark.parametrize("address", ["ftp://127.0.0.1/file", "http://[1/file"])
def test_what_is_no_address_is_told(tmp_path: Path, address: str) -> None:
    assert "not an address" in str(fetched(address, tmp_path).problems[0])


def test_a_certificate_nobody_vouches_for_is_refused_and_a_bundle_mends_it(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    authority = trustme.CA()
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    authority.issue_cert("localhost").configure_cert(context)
    with served(site.folder, context) as secure:
        (problem,) = fetched(f"{secure.address}/file", tmp_path).problems
        assert "localhost cannot be verified" in problem.what
        assert "REQUESTS_CA_BUNDLE" in problem.fix
        authority.cert_pem.write_to_path(str(tmp_path / "bundle.pem"))
        monkeypatch.setenv("REQUESTS_CA_BUNDLE", str(tmp_path / "bundle.pem"))
        assert fetched(f"{secure.address}/file", tmp_path).kind == "new"


def test_a_disk_that_is_full(site: Site, tmp_path: Path) -> None:
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full on this system")
    (tmp_path / "file.part").symlink_to("/dev/full")
    with pytest.raises(SourceError, match="cannot keep the download"):
        fetched(f"{site.address}/file", tmp_path)


def archive(path: Path, members: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w", method) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return path


def test_a_file_too_large_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = archive(tmp_path / "a.zip", {"Art/": b"", "a": bytes(1000)})
    assert fetching.archive_members(path) == ("a",)
    assert fetching.read_member(path, "a") == bytes(1000)
    monkeypatch.setattr(fetching, "_LARGEST", 999)
    with pytest.raises(SourceError, match="1000 bytes"):
        fetching.read_member(path, "a")


def test_a_bomb_that_lies_about_its_size_is_stopped(tmp_path: Path) -> None:
    path = archive(tmp_path / "a.zip", {"a": bytes(100_000)})
    content = bytearray(path.read_bytes())
    # The size unpacked, in the directory at the end and in the member's own header.
    directory = content.rfind(b"PK\x01\x02")
    for place in (directory + 24, 22):
        content[place : place + 4] = struct.pack("<I", 10)
    path.write_bytes(bytes(content))
    assert fetching.archive_members(path) == ("a",)
    with pytest.raises(SourceError, match="damaged"):
        fetching.read_member(path, "a")


def test_only_what_is_stored_or_deflated_is_unpacked(tmp_path: Path) -> None:
    # What packs as LZMA or bzip2 may ask for any amount of memory.
    path = archive(tmp_path / "a.zip", {"Art/view1.png": b"content"}, zipfile.ZIP_LZMA)
    with pytest.raises(SourceError, match="method 14"):
        fetching.read_member(path, "Art/view1.png")


def test_every_bad_line_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.lock"
    path.write_text("0" * 64 + "  good\nbad\n" + "0" * 63 + "  short\n")
    with pytest.raises(SourceError) as caught:
        fetching.read_checksums(path)
    where = [problem.where for problem in caught.value.problems]
    assert where == [f"{path}, line 2", f"{path}, line 3"]


def test_the_manifest_counts_more_than_a_lock_file(tiny_manifest: Manifest, tmp_path: Path) -> None:
    manifest = tiny_manifest.model_copy(update={"checksums": {"a": "1" * 64}})
    fetching.write_checksums(
        tmp_path / fetching.lock_name(manifest), {"a": "2" * 64, "b": "3" * 64}
    )
    assert fetching.known_checksums(manifest, tmp_path) == {"a": "1" * 64, "b": "3" * 64}
    assert fetching.known_checksums(manifest, tmp_path / "empty") == {"a": "1" * 64}
