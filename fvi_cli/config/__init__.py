"""Floor 6: YAML configurations, validated with file, line and column."""

from fvi_cli.config.load import LoadedConfig, load_config, load_values, parse_config
from fvi_cli.config.schema import (
    MODELINE,
    SCHEMA_FILE,
    json_schema,
    schema_text,
    starter_config,
)
from fvi_cli.config.shipped import (
    find_config,
    guide_page,
    guide_pages,
    shipped_configs,
    shipped_titles,
)

__all__ = [
    "MODELINE",
    "SCHEMA_FILE",
    "LoadedConfig",
    "find_config",
    "guide_page",
    "guide_pages",
    "json_schema",
    "load_config",
    "load_values",
    "parse_config",
    "schema_text",
    "shipped_configs",
    "shipped_titles",
    "starter_config",
]
