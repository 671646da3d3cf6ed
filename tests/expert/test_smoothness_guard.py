"""The price of smoothness bends where docking suffers."""

import pytest

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.expert.train import guarded_price
from lerobot_spacedock.expert.train_config import TrainExpertConfig


def test_price_halves_below_the_guard_and_grows_back_above_it():
    price = 1.0
    for _ in range(3):
        price = guarded_price(price, 97.0, 98.5)
    assert price == 0.125
    for _ in range(6):
        price = guarded_price(price, 99.0, 98.5)
    assert price == pytest.approx(1.0)


def test_price_stays_within_its_bounds():
    price = 1.0
    for idss in [0.0] * 20:
        price = guarded_price(price, idss, 98.5)
    assert price == 1.0 / 16.0
    assert guarded_price(1.0, 100.0, 98.5) == 1.0
    assert guarded_price(1.0, 0.0, 0.0) == 1.0  # no guard


@pytest.mark.parametrize("percent", [-1.0, 101.0, float("nan")])
def test_a_guard_that_is_no_percentage_is_refused(percent):
    with pytest.raises(InputError, match="smoothness_guard_percent"):
        TrainExpertConfig(smoothness_guard_percent=percent)
