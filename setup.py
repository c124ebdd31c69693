"""Find the packages, and add the manifests, which lie elsewhere: pyproject.toml cannot do both."""

from setuptools import find_packages, setup

setup(packages=[*find_packages(include=["dfdbench", "dfdbench.*"]), "dfdbench.manifests"])
