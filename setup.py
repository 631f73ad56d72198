"""The packages, as they are found: the recipes lie beside the package in a checkout, and inside it once installed."""

from setuptools import find_namespace_packages, setup

setup(packages=[*find_namespace_packages(include=["skillcli", "skillcli.*"]), "skillcli.recipes"])
