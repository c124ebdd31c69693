from dfdbench.leaderboard.ranks import order_of, tied_ranks


def test_ties_share_a_rank_and_what_has_no_score_stands_last() -> None:
    orders = sorted(order_of(*scores) for scores in [(None, 0.0), (0.2, 0.3), (0.2, None)])
    assert [first for first, _ in orders] == [0.2, 0.2, float("inf")]
    assert tied_ranks(orders) == [1, 2, 3]
    assert tied_ranks([(0.1, 0.1), (0.1, 0.1), (0.1, 0.2), (0.1, 0.2)]) == [1, 1, 3, 3]
    assert tied_ranks([]) == []
