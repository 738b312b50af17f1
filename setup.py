"""The packages that are built: those in ``fvi_cli/``, configurations and pages from beside it."""

from setuptools import find_packages, setup

# packages without modules: folders beside the package, installed inside of it
SHIPPED = {"fvi_cli.shipped_configs": "configs", "fvi_cli.guide": "docs"}

setup(
    packages=[*find_packages(include=["fvi_cli", "fvi_cli.*"]), *SHIPPED],
    package_dir=SHIPPED,
)
