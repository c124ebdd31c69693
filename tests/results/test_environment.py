from dfdbench.results.environment import describe_environment


def test_the_environment_is_described_without_paths() -> None:
    environment = describe_environment()
    assert environment.cpu
    assert environment.cpu_count >= 1
    assert environment.threads["numba"] >= 1
    assert {"numpy", "numba", "dfdbench"} <= set(environment.versions)
    assert "/" not in environment.platform
