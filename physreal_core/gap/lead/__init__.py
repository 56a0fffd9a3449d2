"""A disagreement that no effect of the library explains, as a force field and a short formula."""
