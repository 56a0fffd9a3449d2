"""The two number types of the laws: a test that takes `form` holds both."""

import pytest

from tests.simulation.laws.driver import FORMS


@pytest.fixture(params=FORMS)
def form(request: pytest.FixtureRequest) -> str:
    return request.param
