"""The captures of one case, in a process of its own: `python -m benchmarks.gap.filming FOLDER NAME`.

The rig runs on cores alone, so captures can be made before a card is there. Those with a video go through perception, too (`rgbd`).
"""

import sys
from pathlib import Path

from benchmarks.gap.case import capture
from benchmarks.gap.cases import GapCase
from benchmarks.gap.files import failure_told

FILMED = ("captures",)
"""What a case has then."""

PERCEIVED = "perceived.json"
"""Seconds of each stage of perception, of a case from RGB-D whose recordings have all been through it."""


def film_case(case: GapCase, folder: Path) -> None:
    """Makes the captures of a case in `folder`/<name>; what the rig raises stands in `failed.txt`, too."""
    own = folder / case.name
    with failure_told(own):
        capture(case, own)


if __name__ == "__main__":
    film_case(GapCase.named(sys.argv[2]), Path(sys.argv[1]))
