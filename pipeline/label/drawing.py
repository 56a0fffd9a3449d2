"""What is drawn over the pictures of the page, as SVG in pixels of the picture."""

from collections.abc import Iterable

from pipeline.clicks import Clicks
from pipeline.label.pictures import COLOURS, Sheet
from pipeline.products.masks import Role


def clicks_svg(clicks: Clicks, role: Role, scale: float) -> str:
    """Clicks on a thing as dots of its colour, those off it as crosses; a box as a dashed rectangle.

    Args:
        clicks: in pixels, centres at integers.
        role: which thing.
        scale: size of the marks [px].
    """
    colour = "rgb({},{},{})".format(*COLOURS[role])
    parts = []
    if clicks.box is not None:
        u0, v0, u1, v1 = clicks.box
        place = f'x="{u0:g}" y="{v0:g}" width="{u1 - u0 + 1:g}" height="{v1 - v0 + 1:g}"'
        parts.append(
            f'<rect {place} fill="none" stroke="{colour}" stroke-dasharray="6 4" stroke-width="{scale / 4:g}"/>'
        )
    for (u, v), label in zip(clicks.points, clicks.labels, strict=True):
        u, v = u + 0.5, v + 0.5
        if label:
            edge = f'stroke="black" stroke-width="{scale / 4:g}"'
            parts.append(f'<circle cx="{u:g}" cy="{v:g}" r="{scale:g}" fill="{colour}" {edge}/>')
        else:
            arms = f"M{u - scale:g},{v - scale:g} l{2 * scale:g},{2 * scale:g} m0,{-2 * scale:g} l{-2 * scale:g},{2 * scale:g}"
            for width, ink in ((scale, "black"), (scale / 2, colour)):
                parts.append(f'<path d="{arms}" stroke="{ink}" stroke-width="{width:g}" fill="none"/>')
    return "".join(parts)


def preview_svg(path: str, role: Role, scale: float) -> str:
    """The outline that the clicks ask for, dashed and filled lightly."""
    colour = "rgb({},{},{})".format(*COLOURS[role])
    dashes = f'stroke-dasharray="{scale:g} {scale / 2:g}" stroke-width="{scale / 2:g}"'
    return f'<path d="{path}" fill="{colour}" fill-opacity="0.18" fill-rule="evenodd" stroke="{colour}" {dashes}/>'


def sheet_svg(sheet: Sheet, current: int, suspects: Iterable[int], clicked: Iterable[int]) -> str:
    """Marks on the sheet: red around suspicious frames, blue around those with clicks, white around the one shown."""
    marks = [(t, "#ff5252", 3, 1) for t in suspects]
    marks += [(t, "#40a0ff", 3, 4) for t in clicked] + [(current, "white", 2, 0)]
    width, height = sheet.size
    parts = []
    for t, colour, line, inset in marks:
        u, v = sheet.corner(t)
        place = (
            f'x="{u + inset + 1}" y="{v + inset + 1}" width="{width - 2 * inset - 2}" height="{height - 2 * inset - 2}"'
        )
        parts.append(f'<rect {place} fill="none" stroke="{colour}" stroke-width="{line}"/>')
    return "".join(parts)
