"""The examples of docs/simulation.md run, and say what they claim."""

import re
from pathlib import Path

import torch


def test_the_examples_of_the_docs_run():
    text = (Path(__file__).parents[2] / "docs" / "simulation.md").read_text()
    found = {}
    for example in re.findall(r"```python\n(.*?)```", text, re.DOTALL):
        exec(example, found)  # noqa: S102 (our own text)
    assert found["friction"].grad < 0  # more friction, a shorter slide
    assert found["E"].grad is not None
    torch.testing.assert_close(found["state"].x, found["states"].x[3].detach())
