"""One episode of a LeRobotDataset, as the viewer takes it: the dataset room's own reader."""

from lerobot_spacedock.dataset.stored_episode import DatasetEpisode

__all__ = ["DatasetEpisode"]
