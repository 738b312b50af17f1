"""The text of a configuration: values with places, changes by options, mistakes."""
