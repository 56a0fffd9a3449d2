"""One HTML file that plays the twin's motion in a browser, without Python and without a network."""

from applications.export.page.document import write

__all__ = ["write"]
