from pathlib import Path

from dfdbench.evaluation.photographs import captures_in, lone_images


def test_pairs_are_found_at_any_depth(tmp_path: Path) -> None:
    pairs = ("a/infocus.png", "a/defocus.JPG", "b/c/infocus.png", "b/c/defocus.png")
    for name in (*pairs, "infocus.png"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert list(captures_in(tmp_path)) == ["a", "b/c"]
    alone = f"there is no defocus image beside it ({tmp_path / 'infocus.png'})"
    assert list(map(str, lone_images(tmp_path))) == [alone]
