"""The domain whose commands these tests read."""

import pytest

from cellwright.kb.loader import load_domain
from cellwright.kb.model.domain_model import Domain


@pytest.fixture(scope="session")
def themse() -> Domain:
    return load_domain("themse")
