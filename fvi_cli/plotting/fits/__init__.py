"""Pictures of fits: data and fitted motion, what is left, profiles of the misfit."""
