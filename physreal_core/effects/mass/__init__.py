"""Mass that is not where it was assumed."""
