"""Floor 6: YAML configurations, validated with file, line and column."""

from fvi_cli.config.load import LoadedConfig, load_config, parse_config
from fvi_cli.config.schema import json_schema, starter_config
from fvi_cli.config.shipped import find_config, shipped_configs

__all__ = [
    "LoadedConfig",
    "find_config",
    "json_schema",
    "load_config",
    "parse_config",
    "shipped_configs",
    "starter_config",
]
