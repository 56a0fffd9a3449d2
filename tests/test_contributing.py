"""CONTRIBUTING.md shows the code as it is."""

import re

from tests.conftest import ROOT


def test_the_example_effect_is_the_file():
    page = (ROOT / "CONTRIBUTING.md").read_text()
    example = re.search(r"```python\n(.*?)```", page, re.DOTALL)[1]
    assert example == (ROOT / "physreal_core/effects/around/linear_drag.py").read_text()
