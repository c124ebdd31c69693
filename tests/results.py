"""Results made by hand, for the tests of what reads them."""

from __future__ import annotations

from collections.abc import Mapping

from dfdbench.environment import describe_environment
from dfdbench.protocol import PROTOCOLS
from dfdbench.result import (
    DatasetRecord,
    MethodRecord,
    PairResult,
    PairScores,
    Result,
    average,
)


def make_result(
    nrmse: Mapping[tuple[str, int, int, int], float | None], name: str = "mine"
) -> Result:
    """A complete result under protocol thesis, from NRMSE by (scene, view, illum., exposure).

    NMAE is half the NRMSE, SSIM one less it.
    """
    pairs = []
    for (scene, view, illumination, exposure), value in nrmse.items():
        scores = PairScores(
            nrmse=value, nmae=None if value is None else value / 2,
            ssim=0.5 if value is None else 1 - value,
        )  # fmt: skip
        pairs.append(
            PairResult(
                id=f"{scene}/view{view}/illumination{illumination}/exposure{exposure}",
                scene=scene,
                coordinates={"view": view, "illumination": illumination, "exposure": exposure},
                status="ok",
                seconds=0.25,
                prediction_sha256="0" * 64,
                scores={"thesis": scores},
            )
        )
    return Result(
        schema_version=1,
        dataset=DatasetRecord(
            name="tiny-1", short="tiny", manifest_sha256="1" * 64, fingerprint="2" * 64,
            split="test", expected=len(pairs), evaluated=len(pairs),
            recipe={"name": "published", "parameters": {}}, degradation="clean", options={},
            axes=["view", "illumination", "exposure"], blocks="exposure", rows="illumination",
        ),
        protocols=[PROTOCOLS["thesis"].as_dict()],
        method=MethodRecord(
            name=name, entry="mine:predict", source_sha256=None, parameters={}, uses=[],
            trained_on=None, paper=None,
        ),
        environment=describe_environment(),
        seed=0,
        pairs=pairs,
        averages=average(pairs, ["thesis"]),
    )  # fmt: skip
