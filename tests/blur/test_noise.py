import hashlib
from statistics import NormalDist

import numpy as np
import scipy.stats

from dfdbench.blur.noise import normal_numbers, uniform_numbers


def one_by_one(count: int, text: str) -> list[float]:
    """Philox by its paper (Salmon et al. 2011, 4 x 64, ten rounds) in Python's integers."""
    word = 2**64 - 1
    digest = hashlib.sha256(text.encode()).digest()
    keys = [int.from_bytes(digest[8 * n : 8 * n + 8], "little") for n in range(2)]
    numbers: list[float] = []
    block = 0
    while len(numbers) < count:
        block += 1
        a, b, c, d = block, 0, 0, 0
        k, m = keys
        for _ in range(10):
            first, second = 0xD2E7470EE14C6C93 * a, 0xCA5A826395121157 * c
            a, b, c, d = (second >> 64) ^ b ^ k, second & word, (first >> 64) ^ d ^ m, first & word
            k, m = (k + 0x9E3779B97F4A7C15) & word, (m + 0xBB67AE8584CAA73B) & word
        for bits in (a, b, c, d):
            numbers += [((bits & 0xFFFFFFFF) + 0.5) / 2**32, ((bits >> 32) + 0.5) / 2**32]
    return numbers[:count]


def test_the_numbers_are_those_of_the_generator_s_paper() -> None:
    expected = one_by_one(21, '["camera", 1, "Art/view1"]')
    assert uniform_numbers(21, "camera", 1, "Art/view1").tolist() == expected
    normal = normal_numbers((3, 7), "camera", 1, "Art/view1")
    inverse = NormalDist().inv_cdf
    assert np.allclose(normal.ravel(), [inverse(number) for number in expected], atol=1e-9)


def test_another_key_gives_others_and_a_longer_array_begins_alike() -> None:
    assert not np.array_equal(uniform_numbers(9, "a", "b"), uniform_numbers(9, "ab"))
    assert np.array_equal(uniform_numbers(9, "a")[:4], uniform_numbers(4, "a"))


def test_they_are_normal() -> None:
    numbers = normal_numbers((300, 300), "many")
    assert scipy.stats.kstest(numbers.ravel(), "norm").pvalue > 0.01
    beside = np.corrcoef(numbers[:, :-1].ravel(), numbers[:, 1:].ravel())[0, 1]
    assert abs(beside) < 0.01
