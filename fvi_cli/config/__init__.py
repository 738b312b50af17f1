"""Floor 6: YAML configurations, validated with file, line and column."""
