import numpy as np

from dfdbench.methods.edges import _smooth_rows, within_edges


def test_a_row_is_solved_as_its_matrix_says() -> None:
    random = np.random.default_rng(0)
    fields, ties = random.random((2, 3, 9)), 10 ** random.uniform(-2, 3, (3, 8))
    exact = np.empty_like(fields)
    for y in range(3):
        steps = np.diff(np.eye(9), axis=0)
        matrix = np.eye(9) + steps.T @ np.diag(ties[y]) @ steps
        exact[:, y] = np.linalg.solve(matrix, fields[:, y].T).T
    _smooth_rows(fields, ties)
    np.testing.assert_allclose(fields, exact, rtol=1e-12)


def test_each_field_is_smoothed_by_itself_whatever_the_layout() -> None:
    random = np.random.default_rng(1)
    guide = random.integers(0, 9, (12, 17, 3)).astype(np.uint8)
    fields = random.random((12, 17, 2)).astype(np.float32)
    both = within_edges(np.moveaxis(fields, 2, 0), guide, 20, 3)
    for place in range(2):
        alone = within_edges(fields[np.newaxis, ..., place], guide, 20, 3)
        assert np.array_equal(alone[0], both[place])
    assert np.allclose(within_edges(fields[np.newaxis, ..., 0], guide, 0, 3), fields[..., 0])
    level = within_edges(np.full((1, 12, 17), 7.0), guide, 1e5, 3)
    np.testing.assert_allclose(level, 7.0)
