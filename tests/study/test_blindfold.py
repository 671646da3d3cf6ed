"""Pictures taken away or swapped: what the policy is shown, and that whole episodes fly with it."""

import re

import numpy as np
import pytest
import torch
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.policies import make_pre_post_processors
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy

from lerobot_spacedock.dataset.demos import DemosConfig, demos
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.study.blindfold import blindfold, fly
from lerobot_spacedock.study.blindfold import main as blindfold_main
from lerobot_spacedock.study.picture_use import CAMERA, changes, load_pictures, load_policy
from lerobot_spacedock.study.picture_use import main as picture_use_main

PICTURES = torch.rand(8, 3, 32, 40, generator=torch.Generator().manual_seed(1))


def test_what_is_shown():
    observation = {CAMERA: torch.zeros(4, 3, 32, 40), "observation.state": torch.ones(4, 13)}
    assert blindfold("seen", PICTURES)(observation) is observation
    blank = blindfold("blank", PICTURES)(observation)
    assert torch.allclose(blank[CAMERA][2], PICTURES.mean(dim=(0, 2, 3))[:, None, None].expand(3, 32, 40))
    shuffled = blindfold("shuffled", PICTURES)
    first, second = shuffled(observation)[CAMERA], shuffled(observation)[CAMERA]
    assert all(any(torch.equal(one, other) for other in PICTURES) for one in first)
    assert not torch.equal(first, second)
    assert torch.equal(first, blindfold("shuffled", PICTURES)(observation)[CAMERA])
    assert blank["observation.state"] is observation["observation.state"]
    with pytest.raises(InputError, match="seen shuffled blank"):
        blindfold("closed", PICTURES)


@pytest.mark.parametrize("command", [blindfold_main, picture_use_main])
def test_what_is_not_there_is_named_and_the_hub_is_not_asked(command, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("socket.socket.connect", lambda *_: pytest.fail("a connection"))
    assert command(["--checkpoint", str(tmp_path / "act"), "--root", str(tmp_path / "data")]) == 2
    assert re.search(r"error: --(root|checkpoint): got .*/(data|act); allowed: the", capsys.readouterr().err)
    with pytest.raises(InputError, match="--checkpoint"):
        load_policy(tmp_path / "act")
    with pytest.raises(InputError, match="--root"):
        load_pictures(tmp_path / "data", 4)


def test_another_policy_and_a_dataset_without_pictures_are_refused(tmp_path):
    (tmp_path / "config.json").write_text('{"type": "diffusion", "input_features": {}}')
    with pytest.raises(InputError, match=r"diffusion of nothing; allowed: an ACT that sees"):
        load_policy(tmp_path)
    logs = {"num_episodes": 1, "num_candidates": 1, "expert": "W", "image": False}
    demos(DemosConfig("test/states", str(tmp_path / "data"), **logs))
    with pytest.raises(InputError, match=r"--root: .*a dataset with pictures"):
        load_pictures(tmp_path / "data", 4)


def test_how_far_commands_move_is_measured_apart_for_thrust_and_torque():
    flown = np.zeros((2, 6))
    shuffled, blank, label = np.zeros((3, 2, 6))
    shuffled[0, :3], shuffled[1, 3:] = [3.0, 0.0, 4.0], [0.0, 0.0, 2.0]
    blank[:, 0], label[1, 5] = -1.0, 6.0
    found = changes(flown, shuffled, blank, label)
    assert found["shuffled"] == {"thrust_N": 2.5, "torque_Nm": 1.0}
    assert found["blank"] == {"thrust_N": 1.0, "torque_Nm": 0.0}
    assert found["label"] == {"thrust_N": 0.0, "torque_Nm": 3.0}


@pytest.mark.parametrize("frames", ["-1", "0", "1"])  # one is no other's picture
def test_frames_too_few_to_swap_are_refused(frames, tmp_path, capsys):
    assert picture_use_main(["--checkpoint", str(tmp_path), "--root", str(tmp_path), "--frames", frames]) == 2
    assert f"--frames: got {frames}; allowed: 2 or more" in capsys.readouterr().err


def test_whole_episodes_fly_with_it(tmp_path):
    torch.manual_seed(0)
    config = ACTConfig(
        input_features={
            CAMERA: PolicyFeature(FeatureType.VISUAL, (3, 32, 40)),
            "observation.state": PolicyFeature(FeatureType.STATE, (13,)),
        },
        output_features={"action": PolicyFeature(FeatureType.ACTION, (6,))},
        device="cpu",
        pretrained_backbone_weights=None,
        chunk_size=2,
        n_action_steps=1,
        dim_model=16,
        n_heads=2,
        dim_feedforward=16,
        n_encoder_layers=1,
        use_vae=False,
    )
    statistics = {
        name: {"mean": torch.zeros(shape), "std": torch.ones(shape)}
        for name, shape in ((CAMERA, (3, 1, 1)), ("observation.state", (13,)), ("action", (6,)))
    }
    ACTPolicy(config).save_pretrained(tmp_path / "act")
    for processor in make_pre_post_processors(config, dataset_stats=statistics):
        processor.save_pretrained(tmp_path / "act")
    rows = {
        mode: fly(tmp_path / "act", PICTURES, mode, "same", tmp_path / mode, episodes=2, task="SpaceDock-v0")
        for mode in ("seen", "blank")
    }
    for name, (row,) in zip(("pictures seen", "blank"), rows.values(), strict=True):
        assert (row["run"], row["episodes"], row["steps"]["mean"]) == (name, 2, 65)
    with pytest.raises(SpaceDockError):
        fly(tmp_path / "no_act", PICTURES, "seen", "same", tmp_path / "later", episodes=2)
    with pytest.raises(SpaceDockError, match="nowhere"):
        fly(tmp_path / "act", PICTURES, "seen", "nowhere", tmp_path / "later", episodes=2)
    assert not (tmp_path / "later").exists()  # the same command, mended, may have it
    with pytest.raises(InputError, match="a folder that is not there yet"):
        fly(tmp_path / "act", PICTURES, "seen", "same", tmp_path / "seen", episodes=2)
    with pytest.raises(InputError, match="1 or more"):
        fly(tmp_path / "act", PICTURES, "seen", "same", tmp_path / "other", episodes=0)
    assert rows["seen"][0]["distance_m"] != rows["blank"][0]["distance_m"]
