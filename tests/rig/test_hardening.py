"""How much an effect stiffens a body, which shortens the rig's steps: asked of every effect that is hidden."""

from dataclasses import replace

import pytest

from data.rig.case import Case
from physreal_core.effects import EFFECTS


@pytest.mark.parametrize("form", ["same", "other"])
@pytest.mark.parametrize("effect", EFFECTS)
def test_every_effect_says_by_how_much_it_stiffens(effect, form):
    case = replace(Case.blind(effect, "high", 3, "slab", form), raised=False)
    assert 1.0 <= case.hidden.hardening(case.scene(case.session.seen[0])) < 50.0
