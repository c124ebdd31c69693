import json
import tomllib
from pathlib import Path

from dfdbench.datasets.manifest_file import parse_manifest
from tests.cli.command import Command
from tests.conftest import TINY_TOML


def test_a_proposed_split_is_a_fragment_of_a_manifest(dfdbench: Command, uneven: str) -> None:
    outcome = dfdbench("audit", "split", uneven, "--test-scenes", "2", "--criterion", "thesis")
    assert outcome.status == 0
    assert "(published)" in outcome.out
    fragment = Path("results/uneven-splits/test-2/split.toml").read_text()
    manifest = parse_manifest((TINY_TOML + fragment).encode(), "tiny-1.toml")
    assert set(manifest.scenes_of("train-covered")).isdisjoint(manifest.scenes_of("test-covered"))
    assert len(manifest.scenes_of("test-covered")) == 2
    single = dfdbench("audit", "split", uneven, "--test-scenes", "1", "--format", "json")
    found = json.loads(single.out)
    assert (found["choices"], found["exhaustive"], found["published"]["rank"]) == (3, True, None)
    assert found["candidates"][-1]["test"] == ["Three"]
    folds = dfdbench("audit", "split", uneven, "--folds", "3")
    assert "Three: rare in all other scenes: 36-38" in folds.out
    assert (
        len(tomllib.loads(Path("results/uneven-splits/folds-3/folds.toml").read_text())["folds"])
        == 3
    )
