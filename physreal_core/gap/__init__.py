"""Where simulation and measurement disagree, what is missing, and what is left once it is added (missing_effect.md)."""
