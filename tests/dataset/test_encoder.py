"""A codec or a setting that cannot be used is refused before anything is flown."""

import pytest

from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.dataset.convert import ConvertConfig, convert
from lerobot_spacedock.dataset.demos import DemosConfig, demos
from lerobot_spacedock.dataset.encoder import available_codecs, check_encoder
from lerobot_spacedock.dataset.record import DatasetLayout, Storage
from lerobot_spacedock.errors import InputError

SMALL = CameraConfig(height=48, width=64)


@pytest.mark.parametrize("vcodec", ["vp9", "none"])
def test_demos_refuses_an_unknown_codec_before_it_flies(vcodec, tmp_path):
    root = tmp_path / "data"
    with pytest.raises(InputError, match=rf"--storage\.vcodec: got {vcodec}; allowed: .*libsvtav1"):
        demos(DemosConfig("a/b", root=str(root), camera=SMALL, storage=Storage(vcodec=vcodec)))
    assert list(tmp_path.iterdir()) == []


def test_convert_refuses_it_before_it_reads(log_folder, tmp_path):
    storage, root = Storage(vcodec="vp9"), tmp_path / "data"
    with pytest.raises(InputError, match=r"--storage\.vcodec: got vp9"):
        convert(ConvertConfig(str(log_folder), "a/b", root=str(root), camera=SMALL, storage=storage))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("setting", [{"crf": 99}, {"crf": -1}, {"gop": 0}])
def test_a_setting_outside_the_codecs_range_is_named(setting):
    with pytest.raises(InputError, match=r"--storage: got vcodec=libsvtav1 .*(range|positive)"):
        check_encoder(DatasetLayout("a/b", 48, 64, storage=Storage(**setting)))


@pytest.mark.parametrize("setting", [{"vcodec": "h264"}, {"crf": 12}, {"gop": 10}])
def test_pictures_in_parquet_take_no_encoder_setting(setting):
    with pytest.raises(InputError, match=r"--storage\..*nothing, with --storage.kind=image"):
        Storage(kind="image", **setting)


def test_a_codec_that_is_there_and_fails_is_refused_with_its_reason(monkeypatch):
    """As those of a GPU do where there is none."""
    from lerobot.datasets import video_utils

    def fail(*_, **__):
        raise RuntimeError("no device")

    monkeypatch.setattr(video_utils.StreamingVideoEncoder, "finish_episode", fail)
    with pytest.raises(InputError, match=r"got hevc; allowed: h264 \|.* It does not work here: no device\."):
        check_encoder(DatasetLayout("a/b", 48, 64, storage=Storage(vcodec="hevc")))


@pytest.mark.parametrize("vcodec", ["libsvtav1", "h264"])
def test_codecs_of_the_help_text_encode_here_at_the_least_size(vcodec):
    assert vcodec in available_codecs()
    check_encoder(DatasetLayout("a/b", 16, 32, storage=Storage(vcodec=vcodec)))


def test_frames_that_would_crash_the_encoder_are_refused():
    with pytest.raises(InputError, match=r"image size: got 16x16; .* for video even numbers, 32 wide"):
        DatasetLayout("a/b", 16, 16).columns()
    DatasetLayout("a/b", 16, 16, storage=Storage(kind="image")).columns()
    check_encoder(DatasetLayout("a/b", 16, 16, storage=Storage(kind="image")))
