import json

import numpy as np

from dfdbench.audit.coverage import Criterion, DensityBound
from dfdbench.audit.split_tables import (
    ProposalSettings,
    folds_as_json,
    folds_fragment,
    folds_table,
    ranked_splits_table,
    ranking_as_json,
    split_fragment,
)
from dfdbench.audit.splits import Folds, Scenes, hopeless_scenes, propose_folds, rank_tests
from dfdbench.datasets.manifest import Manifest
from dfdbench.datasets.manifest_file import parse_manifest
from tests.conftest import TINY_TOML


def scenes() -> Scenes:
    counts = np.zeros((3, 256), np.int64)
    counts[:, 100] = 50
    counts[2, 36] = 20
    return Scenes(("One", "Two", "Three"), counts, (("One",), ("Two",), ("Three",)))


def test_the_published_test_has_its_rank_or_a_reason(tiny_manifest: Manifest) -> None:
    ranking = rank_tests(scenes(), 2)
    table = ranked_splits_table(tiny_manifest, ranking, ("Two", "Three"), "either")
    assert sum("(published)" in row[0] for row in table.rows) == 1
    other = ranked_splits_table(tiny_manifest, rank_tests(scenes(), 1), ("Two", "Three"), "either")
    assert "has 2 scenes, not 1" in other.notes[-1]
    none = ranked_splits_table(tiny_manifest, ranking, (), "either")
    assert "no published split" in none.notes[-1]


def test_folds_say_what_the_published_reach_and_what_none_can(tiny_manifest: Manifest) -> None:
    proposals = propose_folds(scenes(), 3)
    hopeless = hopeless_scenes(scenes(), {1})
    published = Folds(tuple(scenes().judge([("One", "Two"), ("Three",)])))
    notes = "\n".join(folds_table(tiny_manifest, proposals, hopeless, published).notes)
    assert "published folds: 2 of 2 not covered" in notes
    assert "at least 1 of 3 folds" in notes
    assert "Three: rare in all other scenes: 36" in notes
    settings = ProposalSettings("f" * 64, scenes(), 5)
    content = json.loads(folds_as_json(tiny_manifest, settings, proposals, hopeless, published))
    assert content["cannot_be_covered"][0]["scene"] == "Three"
    assert content["seed"] == 5


def test_a_ranking_keeps_what_it_depends_on(tiny_manifest: Manifest) -> None:
    counts = scenes().counts[:2]
    bound = DensityBound(4.0, 0.01)
    chosen = Scenes(("One", "Two"), counts, (("One", "Two"),), Criterion.density, bound, 0.1)
    ranking = rank_tests(scenes(), 1)
    content = json.loads(
        ranking_as_json(tiny_manifest, ProposalSettings("f" * 64, chosen, 7), ranking, ())
    )
    assert {key: content[key] for key in list(content)[3:11]} == {
        "fingerprint": "f" * 64,
        "criterion": "density",
        "allowed_share": 0.1,
        "density_factor": 4.0,
        "density_floor": 0.01,
        "seed": 7,
        "absent_scenes": ["Three"],
        "kept_together": [["One", "Two"]],
    }


def test_fragments_complete_a_manifest() -> None:
    own = parse_manifest(TINY_TOML.encode(), "tiny-1.toml")
    fragment = split_fragment(own, ("Three",), ("One", "Two"), "why")
    joined = parse_manifest((TINY_TOML + fragment).encode(), "tiny-1.toml")
    assert len(joined.pairs("test-covered")) == 3
    without = TINY_TOML[: TINY_TOML.index("[[folds]]")] + TINY_TOML[TINY_TOML.index("[[scenes]]") :]
    folds = folds_fragment(propose_folds(scenes(), 3)[0], "why")
    assert len(parse_manifest((without + folds).encode(), "tiny-1.toml").folds) == 3
