"""``spacedock view``: what the log states of its camera is what is drawn, and no flag is without effect."""

import numpy as np
import pytest
from synthetic_logs import fly
from test_view import make_dataset

from lerobot_spacedock.cli import main
from lerobot_spacedock.episode_log import write_episode_log
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.report.view import ViewConfig, view


@pytest.fixture
def drawn_with(monkeypatch):
    """What the renderer was asked for, in place of drawing."""
    asked = {}

    class Artist:
        def __init__(self, **options):
            asked.update(options)

        def draw(self, log, first, last):
            yield from np.zeros((last - first, 48, 64, 3), np.uint8)

        def close(self):
            pass

    monkeypatch.setattr("lerobot_spacedock.report.view.Artist", Artist)
    return asked


@pytest.fixture
def log_file(tmp_path):
    stated = {"camera": {"detail": "high", "height": 96, "width": 128}, "renderer": "pyrender"}
    return write_episode_log(tmp_path / "episode_000001.parquet", fly(1, steps=3, config=stated))


def test_a_picture_is_drawn_as_the_log_states_unless_the_user_says_otherwise(log_file, tmp_path, drawn_with):
    assert view(ViewConfig(log=log_file, render=tmp_path / "a.png")) == 0
    assert drawn_with["renderer"] == "pyrender"
    assert (drawn_with["camera"]["detail"], drawn_with["camera"]["height"]) == ("high", 96)
    assert view(ViewConfig(log=log_file, render=tmp_path / "a.png", renderer="software", detail="low")) == 0
    assert (drawn_with["renderer"], drawn_with["camera"]["detail"]) == ("software", "low")


def test_where_a_log_states_nothing_the_environments_defaults_are_drawn(tmp_path, drawn_with):
    path = write_episode_log(tmp_path / "episode_000001.parquet", fly(1, steps=3))
    assert view(ViewConfig(log=path, render=tmp_path / "a.png")) == 0
    assert drawn_with["renderer"] == "software"
    assert drawn_with["camera"].get("detail", "low") == "low"


@pytest.mark.parametrize(
    ("option", "other", "needed"),
    [
        ({"at": 1.0}, {"video": "a.mp4"}, "--render"),
        ({"fps": 24.0}, {"render": "a.png"}, "--video"),
        ({"speed": 2.0}, {}, "--video"),
        ({"episode": 0}, {"render": "a.png"}, "--dataset"),
        ({"camera": False}, {"render": "a.png"}, "--save"),
    ],
)
def test_a_flag_that_would_do_nothing_is_refused(log_file, tmp_path, drawn_with, option, other, needed):
    other = {name: tmp_path / file for name, file in other.items()}
    with pytest.raises(InputError, match=f"--{next(iter(option))}: got .*nothing, unless {needed} is given"):
        view(ViewConfig(log=log_file, **option, **other))


@pytest.mark.parametrize("option", [{"height": 96}, {"width": 128}, {"detail": "high"}, {"renderer": "pyrender"}])
def test_how_to_draw_is_refused_where_nothing_is_drawn(log_file, tmp_path, drawn_with, monkeypatch, option):
    monkeypatch.setattr("lerobot_spacedock.report.view.show_episode", lambda log, seen, **_: list(seen))
    root = make_dataset(tmp_path / "set", fly(3, steps=2), [np.zeros((12, 16, 3), np.uint8)] * 2)
    for source, why in (({"dataset": root}, "own pictures"), ({"log": log_file, "camera": False}, "camera=false")):
        with pytest.raises(InputError, match=f"--{next(iter(option))}: got .*nothing.*{why}"):
            view(ViewConfig(save=tmp_path / "a.rrd", **source, **option))
        assert view(ViewConfig(save=tmp_path / "a.rrd", render=tmp_path / "a.png", **source, **option)) == 0
    assert view(ViewConfig(log=log_file, save=tmp_path / "a.rrd", **option)) == 0


@pytest.mark.parametrize(
    ("flag", "file", "then"), [("render", "a.png", "video=a.mp4"), ("video", "a.gif", "save=a.rrd")]
)
def test_the_next_command_is_printed_and_parses(log_file, drawn_with, capsys, monkeypatch, flag, file, then):
    monkeypatch.chdir(log_file.parent)
    assert main(["view", f"--log={log_file.name}", f"--{flag}={file}"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"Next: spacedock view --log={log_file.name} --{then}"
