"""The packages that are built: those found in ``fvi_cli/``, and the configurations beside it."""

from setuptools import find_packages, setup

SHIPPED = "fvi_cli.shipped_configs"

setup(
    packages=[*find_packages(include=["fvi_cli", "fvi_cli.*"]), SHIPPED],
    package_dir={SHIPPED: "configs"},
)
