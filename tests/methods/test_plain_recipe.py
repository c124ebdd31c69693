"""What the solvers that learned to calibrate answer where they are told a plain recipe."""

import hashlib

import numpy as np

from dfdbench.blur.formation import uniform_numbers
from dfdbench.blur.recipe import RECIPES
from dfdbench.blur.synthesis import synthesize
from dfdbench.methods.registry import load

HEIGHT, WIDTH = 40, 56


def made() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coarse and fine random texture, by whole numbers, over two planes and a slope."""
    fine = uniform_numbers(HEIGHT * WIDTH * 3, "golden", "fine").reshape(HEIGHT, WIDTH, 3)
    coarse = uniform_numbers(HEIGHT * WIDTH // 16 * 3, "golden", "coarse")
    blocks = coarse.reshape(HEIGHT // 4, WIDTH // 4, 3).repeat(4, 0).repeat(4, 1)
    infocus = np.floor(30 + 120 * blocks + 80 * fine).astype(np.uint8)
    depth = np.full((HEIGHT, WIDTH), 60, np.uint8)
    depth[:, 20:] = 200
    depth[24:] = np.arange(WIDTH) * 3 + 40
    return infocus, synthesize(infocus, depth, RECIPES["published"]), depth


def test_told_a_recipe_they_answer_bit_for_bit_as_before() -> None:
    infocus, defocus, depth = made()
    for name, digest in {
        "local": "a7d62d59870bef6007e8334784f28c48455565a00d6c87c4e852249e4ff41f95",
        "graph-cuts": "ad03664062f39630748e653ad5c8484e6cc67d3c8ecfff662344ad32570ab82a",
        "graph-cuts-rounded": "f9f9bd83cacb52c4dc7de1b1679e47a50b11fdbdf4e0c01ebf3da5761b35ec27",
    }.items():
        found = load(name, recipe="published")(infocus, defocus)
        assert np.abs(found - depth)[4:-4, 4:-4].mean() < 12
        found = np.ascontiguousarray(found, np.float32)
        assert hashlib.sha256(found.tobytes()).hexdigest() == digest, name
