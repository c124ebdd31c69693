import pytest
import torch

from dfdbench.methods.networks.stack import DEPTHS, StackNet, places_of


def test_places_rise_and_reach_a_little_beyond_the_focus() -> None:
    focus = torch.tensor([[0.0, 0.1, 0.5, 1.0]])
    places = places_of(focus)
    assert (places.diff() > 0).all()
    assert torch.equal(places[:, 1::DEPTHS], focus)
    assert places[0, 0].item() == pytest.approx(-0.2 / 3)
    assert places[0, -1].item() == pytest.approx(1 + 1 / 3)


@pytest.mark.parametrize("count", [3, 4, 10])
def test_any_number_of_images_has_three_depths_each(count: int) -> None:
    network = StackNet(4, (4, 6))
    images, focus = torch.rand(2, count, 32, 40), torch.linspace(0, 1, count).repeat(2, 1)
    logits, mask = network(images, focus)
    assert logits.shape == (2, DEPTHS * count, 8, 10)
    assert mask.shape == (2, 9 * 16, 8, 10)
    assert torch.isfinite(logits).all()


def test_black_images_and_any_scale_of_the_focus_have_an_answer() -> None:
    network = StackNet(4, (4, 6))
    images, focus = torch.rand(1, 4, 16, 24), torch.tensor([[0.0, 1.0, 2.0, 4.0]])
    for shown in (images, torch.zeros_like(images)):
        near, far = (network(shown, place)[0] for place in (focus, 100 + 7 * focus))
        assert torch.isfinite(near).all()
        torch.testing.assert_close(near, far, rtol=1e-3, atol=1e-3)
