"""The plot of the page: areas of the masks and visible share of the tracks over the frames, for ECharts."""

from typing import Any

from pipeline.label.pictures import COLOURS
from pipeline.label.suspects import Curves


def plot_options(curves: Curves | None, suspects: dict[int, list[str]], current: int) -> dict[str, Any]:
    """Options of an ECharts plot; suspicious frames are red lines, the one shown a black line."""
    series = []
    if curves is not None:
        largest = max(float(curves.object.max()), float(curves.controller.max()), 1e-9)
        shown = (
            ("object's area", curves.object / largest, "rgb({},{},{})".format(*COLOURS["object"])),
            ("hand's area", curves.controller / largest, "rgb({},{},{})".format(*COLOURS["controller"])),
            ("visible tracks", curves.seen, "#888888"),
        )
        for name, values, colour in shown:
            points = [[t, round(float(value), 4)] for t, value in enumerate(values)]
            look = {"symbolSize": 4, "lineStyle": {"color": colour}, "itemStyle": {"color": colour}}
            series.append({"name": name, "type": "line", "data": points, **look})
        red = [{"xAxis": t, "lineStyle": {"color": "#ff5252", "type": "solid", "opacity": 0.4}} for t in suspects]
        here = [{"xAxis": current, "lineStyle": {"color": "#000000", "type": "solid"}}]
        series[0]["markLine"] = {"symbol": "none", "silent": True, "label": {"show": False}, "data": red + here}
    return {
        "animation": False,
        "grid": {"left": 40, "right": 12, "top": 28, "bottom": 24},
        "legend": {"top": 0},
        "tooltip": {"trigger": "axis"},
        "xAxis": {"type": "value", "min": 0, "max": "dataMax", "minInterval": 1},
        "yAxis": {"type": "value", "min": 0, "max": 1},
        "series": series,
    }
