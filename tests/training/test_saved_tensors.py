from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="needs the extra nets")
import torch

from dfdbench.training.saved_tensors import counts, moments_of, require_plain_archive


def test_an_archive_is_read_as_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "a.pt"
    torch.save({"a": torch.ones(3)}, path)
    require_plain_archive(path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("more", b"0" * 10**6)
    with pytest.raises(ValueError, match="more is compressed"):
        require_plain_archive(path)


def test_counts_are_copied_and_whole() -> None:
    one = torch.ones(1, dtype=torch.int64).expand(4)
    found = counts({"a": one}, "a", 4)
    found[0] = 5
    assert found.tolist() == [5, 1, 1, 1]
    for wrong in (one[:3], one.float(), -one, [1, 1, 1, 1]):
        with pytest.raises(ValueError, match=r"^a "):
            counts({"a": wrong}, "a", 4)


def test_what_adam_keeps_comes_back_and_nothing_else() -> None:
    parameters = [torch.nn.Parameter(torch.ones(2, 3)), torch.nn.Parameter(torch.ones(4))]
    optimizer = torch.optim.Adam(parameters)
    assert moments_of(optimizer.state_dict(), parameters) == {}
    sum(parameter.sum() for parameter in parameters).backward()  # type: ignore[union-attr]
    optimizer.step()
    found = moments_of({**optimizer.state_dict(), "harm": 1}, parameters)
    assert {number: sorted(kept) for number, kept in found.items()} == {
        number: ["exp_avg", "exp_avg_sq", "step"] for number in (0, 1)
    }
    for parameter, kept in zip(parameters, found.values(), strict=True):
        assert torch.equal(kept["exp_avg"], optimizer.state[parameter]["exp_avg"])
    with pytest.raises(ValueError, match="another shape"):
        moments_of(optimizer.state_dict(), parameters[::-1])
    with pytest.raises(ValueError, match="other parameters"):
        moments_of(optimizer.state_dict(), parameters[:1])
