"""A bag of one Imu topic, as the library writes it."""

from __future__ import annotations

import pytest
from helpers.bags_by_hand import imu_series

from track_localization.io.bags import BagWriter


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / 'bag') as writer:
        writer.write_imu('imu/data_raw', imu_series())
    return tmp_path / 'bag'
