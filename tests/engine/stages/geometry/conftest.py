"""Arms and cells that the tests of geometry share."""

import numpy as np
import pytest

from cellwright.engine.stages.geometry.kinematics.arm_model import ArmModel
from cellwright.kb.loader.arm_file import bundled_arms, load_arm

ARMS = sorted(bundled_arms())


@pytest.fixture(scope="session")
def models() -> dict[str, ArmModel]:
    return {name: ArmModel(load_arm(path)) for name, path in bundled_arms().items()}


@pytest.fixture(params=ARMS)
def model(request: pytest.FixtureRequest, models: dict[str, ArmModel]) -> ArmModel:
    return models[request.param]


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(20)
