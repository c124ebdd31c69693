import torch

from dfdbench.methods.networks.stack import StackNet


def test_black_images_and_any_scale_of_the_focus_have_an_answer() -> None:
    network = StackNet(4, (4, 6))
    images, focus = torch.rand(1, 4, 16, 24), torch.tensor([[0.0, 1.0, 2.0, 4.0]])
    for shown in (images, torch.zeros_like(images)):
        near, far = (network(shown, place)[0] for place in (focus, 100 + 7 * focus))
        assert torch.isfinite(near).all()
        torch.testing.assert_close(near, far, rtol=1e-3, atol=1e-3)
