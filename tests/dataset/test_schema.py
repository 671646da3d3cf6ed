"""The one schema: what LeRobot makes of it, and that it says what the frames of physics say."""

import pytest
from lerobot.configs import FeatureType
from lerobot.utils.feature_utils import dataset_to_policy_features

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.errors import InputError


def test_policies_see_the_observation_and_the_label_and_nothing_else():
    found = dataset_to_policy_features(schema.features(height=48, width=64))
    assert {name: feature.type for name, feature in found.items()} == {
        "observation.images.camera": FeatureType.VISUAL,
        "observation.state": FeatureType.STATE,
        "action": FeatureType.ACTION,
    }
    assert found["observation.images.camera"].shape == (3, 48, 64)


def test_state_order_is_that_of_the_published_dataset():
    without, with_mass = (schema.columns(with_mass=flag)[schema.STATE].names for flag in (False, True))
    assert without == ("x", "y", "z", "vx", "vy", "vz", "q0", "q1", "q2", "q3", "w1", "w2", "w3")
    assert with_mass == ("x", "y", "z", "vx", "vy", "vz", "mass", "q0", "q1", "q2", "q3", "w1", "w2", "w3")


@pytest.mark.parametrize("options", [{}, {"with_mass": True}, {"image": False}, {"storage": "image"}])
def test_each_component_has_a_name_and_a_unit(options):
    for name, column in schema.columns(**options).items():
        if name != schema.IMAGE:
            assert len(column.names) == len(column.units) == column.shape[0]
            assert column.meaning.endswith(".")


@pytest.mark.parametrize("options", [{"storage": "gif"}, {"height": 8}, {"height": 47}, {"height": 32, "width": 30}])
def test_what_the_encoder_cannot_take_is_refused(options):
    with pytest.raises(InputError):
        schema.columns(**options)


def test_odd_sizes_are_fine_for_pictures():
    assert schema.columns(height=47, width=65, storage="image")[schema.IMAGE].shape == (47, 65, 3)
