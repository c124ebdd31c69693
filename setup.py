"""Find the packages, and add two that lie elsewhere: pyproject.toml cannot do both."""

from setuptools import find_packages, setup

_ELSEWHERE = ["dfdbench.manifests", "dfdbench.rows"]
setup(packages=[*find_packages(include=["dfdbench", "dfdbench.*"]), *_ELSEWHERE])
