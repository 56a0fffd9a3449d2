"""Every material option composes into parameters that Stage 1 accepts."""

import pytest
import yaml

from pipeline.compose import CONF, compose

LAWS = {
    "default": ("fixed_corotated", "identity", None),
    "neo_hookean": ("neo_hookean", "identity", None),
    "hencky": ("hencky", "identity", None),
    "saint_venant_kirchhoff": ("saint_venant_kirchhoff", "identity", None),
    "von_mises": ("hencky", "von_mises", (5e3, 0.0)),
    "drucker_prager": ("hencky", "drucker_prager", (0.6, 0.0)),
}


@pytest.mark.parametrize("option", LAWS)
def test_an_option_sets_the_laws_and_nothing_else(option):
    from pipeline.config.fit_global import FitGlobal

    chosen = {"default": [], option: [] if option == "default" else [f"fit_global={option}"]}
    blocks = {name: yaml.safe_load(compose(given))["fit_global"] for name, given in chosen.items()}
    material = FitGlobal(**blocks[option]).material
    assert (material.elastic_law, material.plastic_law, material.plastic()) == LAWS[option]
    without = [{key: value for key, value in block.items() if key != "material"} for block in blocks.values()]
    assert without[0] == without[-1]


def test_every_option_is_listed_here():
    """Without a choice, pipeline/config gives the default."""
    assert {path.stem for path in (CONF / "fit_global").glob("*.yaml")} == LAWS.keys() - {"default"}
