"""The example of docs/simulation.md runs, and says what it claims."""

import re
from pathlib import Path


def test_the_example_of_the_docs_runs():
    text = (Path(__file__).parents[2] / "docs" / "simulation.md").read_text()
    found = {}
    exec(re.search(r"```python\n(.*?)```", text, re.DOTALL).group(1), found)  # noqa: S102 (our own text)
    assert found["friction"].grad < 0  # more friction, a shorter slide
    assert found["E"].grad is not None
