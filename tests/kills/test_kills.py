"""Each verb killed at random moments; the same command then ends as if nothing had happened.

Every other kill comes while a file is written: those moments are short, and the ones that hurt.

Six kills a verb, `make kills COUNT=100` more.
"""

import hashlib
import multiprocessing
import os
import random
import shutil
import signal
import sys
import time
import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra nets")
from dfdbench.cli import main
from dfdbench.datasets.dataset import Dataset
from dfdbench.datasets.fingerprint import verify_store
from dfdbench.methods.networks.weights import load_weights
from dfdbench.results.record import load_result
from tests.conftest import ON_SERVERS, TINY_TOML
from tests.fuzz.bench import SEARCH, TRAIN, Bench
from tests.fuzz.worker import call
from tests.site import served
from tests.training.search.made_searches import losses

KILLS = int(os.environ.get("DFDBENCH_KILLS", "6"))
#: Kills of one piece of work, before it is let end: the later ones hit what is left to do.
_IN_A_ROW = 3


def _result(folder: Path) -> object:
    result = load_result(folder / "out")
    pairs = [(pair.id, pair.prediction_sha256, pair.scores) for pair in result.pairs]
    return pairs, result.averages


def _fitted(folder: Path) -> object:
    with np.load(folder / "out/fit.npz") as learned:
        curve = learned["learned.level"].item(), learned["learned.curve"].tolist()
    return _result(folder), curve


def _trained(folder: Path) -> object:
    network, card = load_weights(folder / "training/weights.safetensors", "dfd-net")
    losses = (folder / "training/losses.csv").read_text()
    weights = {name: values.tolist() for name, values in network.state_dict().items()}
    return losses, weights, card.scores, card.steps


def _searched(folder: Path) -> object:
    return losses(folder / "search"), len(list((folder / "search/particles").iterdir()))


def _page(folder: Path) -> object:
    # A kill while a file is written leaves a hidden part of it.
    files = sorted(path for path in (folder / "page").rglob("[!.]*") if path.is_file())
    return {str(path.relative_to(folder)): _sha256(path) for path in files}


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@dataclass(frozen=True)
class Work:
    """A command, the files that it needs, and what is to be the same after kills."""

    command: str
    needs: tuple[str, ...]
    outcome: Callable[[Path], object]

    def words(self, folder: Path) -> str:
        """Return the command as what lies in the folder asks for it: a training is said."""
        training = folder / "training"
        if (training / "checkpoint.pt").exists():
            return f"{self.command} --resume"
        return f"{self.command} --fresh" if training.exists() else self.command


WORKS = {
    "run": Work(
        "run --method local --dataset tiny.zarr --out out --no-predictions", ("tiny.zarr",), _result
    ),
    "fit": Work(
        "run --method mine.py:Fitted --dataset tiny.zarr --out out --no-predictions",
        ("tiny.zarr", "mine.py"),
        _fitted,
    ),
    "train": Work(
        f"{TRAIN} --set steps=24 --set evaluate_every=6", ("tiny.zarr", "quick.toml"), _trained
    ),
    "search": Work(
        SEARCH.replace("--particles 1 --iterations 0", "--particles 2 --iterations 1"),
        ("tiny.zarr", "quick.toml"),
        _searched,
    ),
    "score": Work(
        "score --predictions maps --dataset tiny.zarr --method mine --out out",
        ("tiny.zarr", "maps"),
        _result,
    ),
    "report": Work("report run other --format markdown --out page", ("run", "other"), _page),
    "leaderboard": Work(
        "leaderboard --folder board", ("board",), lambda folder: _sha256(folder / "board/README.md")
    ),
}


def _child(
    folder: str, arguments: list[str], environment: Mapping[str, str], last: int, writes: Any
) -> None:
    whole = os.fsync

    def write(fd: Any) -> None:
        writes.value += 1
        if writes.value == last:
            os.kill(os.getpid(), signal.SIGKILL)
        whole(fd)

    os.fsync = write
    os.environ.update(environment)
    os.chdir(folder)
    sys.path.insert(0, folder)
    sys.argv = ["dfdbench", *arguments]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    main()


class Killer:
    """Starts a command in children that have imported everything, and kills them.

    A kill then hits the work and not the start.
    """

    def __init__(self, environment: Mapping[str, str]) -> None:
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload([__name__])
        self._environment = dict(environment)
        self._moments = random.Random(7)
        # How many files the command last wrote that was let end.
        self._writes = self._context.Value("i")
        self._in_writes = False
        self._begun("list", Path()).join()

    def _begun(self, command: str, folder: Path, last: int = 0) -> Any:
        writes = self._context.Value("i") if last else self._writes
        words = (str(folder.resolve()), command.split(), self._environment, last, writes)
        process = self._context.Process(target=_child, args=words)
        process.start()
        return process

    def seconds(self, command: str, folder: Path) -> float:
        """Let a command end; return how long that took."""
        self._writes.value = 0
        begun = time.monotonic()
        process = self._begun(command, folder)
        process.join()
        assert process.exitcode == 0
        return time.monotonic() - begun

    def kill(self, command: str, folder: Path, takes: float) -> bool:
        """Begin a command and kill it; return whether it had not ended before."""
        self._in_writes = not self._in_writes and self._writes.value > 0
        last = self._moments.randint(1, self._writes.value) if self._in_writes else 0
        process = self._begun(command, folder, last)
        process.join(None if last else self._moments.uniform(0.02, 0.9) * takes)
        process.kill()
        process.join()
        return bool(process.exitcode)


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return Bench(tmp_path_factory.mktemp("sound") / "bench", call)


def kill_and_compare(
    killer: Killer,
    laid_out: Callable[[str], Path],
    words: Callable[[Path], str],
    outcome: Callable[[Path], object],
) -> None:
    """Kill a command in several places, let it end there, and compare what it came to."""
    whole = laid_out("whole")
    takes = killer.seconds(words(whole), whole)
    expected = outcome(whole)
    killed = 0
    for number in range(0, KILLS, _IN_A_ROW):
        folder = laid_out(f"killed-{number}")
        for _ in range(_IN_A_ROW):
            killed += killer.kill(words(folder), folder, takes)
        killer.seconds(words(folder), folder)
        assert outcome(folder) == expected
        shutil.rmtree(folder)
    assert killed >= KILLS // 3


@pytest.mark.slow
@pytest.mark.parametrize("name", WORKS)
def test_killed_at_random_moments_it_ends_the_same(name: str, bench: Bench, tmp_path: Path) -> None:
    work = WORKS[name]

    def laid_out(place: str) -> Path:
        return bench.laid_out(tmp_path / place, work.needs)

    killer = Killer({"DFDBENCH_CACHE": str(tmp_path / "cache")})
    kill_and_compare(killer, laid_out, work.words, work.outcome)


def _stored(place: str | Path) -> str:
    store = Dataset(place)
    assert verify_store(store).sound
    return store.fingerprint


@pytest.mark.slow
@pytest.mark.parametrize("where", ["disk", pytest.param("object store", marks=ON_SERVERS)])
def test_a_build_ends_the_same(
    where: str, bench: Bench, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    base = ""
    if where == "object store":
        base = f"{request.getfixturevalue('object_store')}/{uuid.uuid4().hex}/"
    aws = {name: value for name, value in os.environ.items() if name.startswith("AWS_")}
    killer = Killer(aws)
    bench.copy("site", tmp_path / "server/data/scenes")
    (tmp_path / "server/data/scenes/site").rename(tmp_path / "server/data/scenes/ThirdSize")
    with served(tmp_path / "server") as site:
        address = f"{site.address}/data/scenes/ThirdSize"
        manifest = TINY_TOML.replace("https://example.org/tiny", address)

        def laid_out(place: str) -> Path:
            (tmp_path / place).mkdir()
            (tmp_path / place / "tiny-1.toml").write_text(manifest)
            return tmp_path / place

        def store(folder: Path) -> str:
            return f"{base}{folder.name}.zarr" if base else str(folder / "s.zarr")

        def words(folder: Path) -> str:
            return f"build tiny-1.toml --cache cache --workers 2 --store {store(folder)}"

        kill_and_compare(killer, laid_out, words, lambda folder: _stored(store(folder)))


@pytest.mark.slow
def test_a_registration_ends_the_same(captures: Path, tmp_path: Path) -> None:
    def laid_out(place: str) -> Path:
        shutil.copytree(captures / "k03", tmp_path / place / "raw/k03")
        return tmp_path / place

    kill_and_compare(
        Killer({"DFDBENCH_CACHE": str(tmp_path / "cache")}),
        laid_out,
        lambda folder: "rig register k03 --source raw --fresh",
        lambda folder: (folder / "raw/k03/registration.toml").read_text(),
    )
