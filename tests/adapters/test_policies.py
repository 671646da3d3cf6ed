"""The experts as LeRobot policies: built, saved, loaded and reset as any other."""

import json

import numpy as np
import pytest
import torch
from lerobot.configs import FeatureType, PolicyFeature, PreTrainedConfig
from lerobot.policies.factory import make_policy, make_policy_config, make_pre_post_processors
from lerobot.utils.constants import ACTION, OBS_STATE
from local_hub import TOKEN, LocalHub

from lerobot_spacedock.adapters import SpaceDockEnvConfig
from lerobot_spacedock.adapters.command_line import OptionError
from lerobot_spacedock.env.batch import BatchedSpaceDock
from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.expert.controllers import make_expert

TYPES = ("spacedock_meta_rl", "spacedock_mpc", "spacedock_zem", "spacedock_feedback")
ENV = {"obs_type": "agent_pos"}


def build(policy_type, env=ENV, **options):
    config = make_policy_config(policy_type, device="cpu", **options)
    return make_policy(config, env_cfg=SpaceDockEnvConfig(**env))


def states(count, seed=0):
    rng = np.random.default_rng(seed)
    state = np.zeros((count, 13), dtype=np.float32)
    state[:, :3] = rng.uniform([-1, -26, -1], [1, -24, 1], (count, 3))
    state[:, 3:6] = rng.uniform(-0.1, 0.1, (count, 3))
    state[:, 6:10] = [np.sqrt(0.5), -np.sqrt(0.5), 0.0, 0.0]
    state[:, 10:] = rng.uniform(-0.1, 0.1, (count, 3))
    return torch.from_numpy(state)


def fly(policy, seeds=(0, 1, 2), count=3):
    policy.reset()
    return torch.stack([policy.select_action({OBS_STATE: states(count, seed)}) for seed in seeds])


@pytest.mark.parametrize("policy_type", TYPES)
def test_a_command_is_a_finite_body_wrench_within_the_limits(policy_type):
    actions = fly(build(policy_type))
    assert actions.shape == (3, 3, 6)
    assert actions.dtype == torch.float32
    assert torch.isfinite(actions).all()
    assert (actions[..., :3].abs() <= 60.0).all()
    assert (actions[..., 3:].abs() <= 20.0).all()
    # At rest 25 m out on -V-bar the way to the port is along +y: body +z.
    assert (actions[0, :, 2] > 1.0).all()


@pytest.mark.parametrize("policy_type", TYPES)
def test_reset_forgets_everything(policy_type):
    policy = build(policy_type)
    torch.testing.assert_close(fly(policy), fly(policy), rtol=0, atol=0)


def test_the_memory_matters_until_reset():
    policy = build("spacedock_meta_rl")
    policy.reset()
    first = policy.select_action({OBS_STATE: states(3)})
    again = policy.select_action({OBS_STATE: states(3)})
    assert not torch.equal(first, again)


@pytest.mark.parametrize("policy_type", TYPES)
def test_each_episode_of_a_batch_is_flown_as_if_alone(policy_type):
    policy = build(policy_type)
    together = fly(policy)
    for row in range(3):
        policy.reset()
        for step, seed in enumerate((0, 1, 2)):
            alone = policy.select_action({OBS_STATE: states(3, seed)[row : row + 1]})
            torch.testing.assert_close(alone[0], together[step, row], rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("policy_type", TYPES)
def test_a_state_with_mass_gives_the_same_command(policy_type):
    with_mass = build(policy_type, env=ENV | {"with_mass": True})
    state = states(2)
    mass = torch.full((2, 1), 1000.0)
    heavy = torch.cat([state[:, :6], mass, state[:, 6:]], dim=1)
    plain = build(policy_type).select_action({OBS_STATE: state})
    torch.testing.assert_close(with_mass.select_action({OBS_STATE: heavy}), plain, rtol=0, atol=0)


@pytest.mark.parametrize("policy_type", TYPES)
def test_saved_and_loaded_it_flies_the_same(policy_type, tmp_path):
    policy = build(policy_type)
    policy.save_pretrained(tmp_path)
    assert {path.suffix for path in tmp_path.iterdir()} == {".json", ".safetensors"}
    config = PreTrainedConfig.from_pretrained(tmp_path)
    config.pretrained_path = tmp_path
    loaded = make_policy(config, env_cfg=SpaceDockEnvConfig(**ENV))
    torch.testing.assert_close(fly(loaded), fly(policy), rtol=0, atol=0)
    pre, post = make_pre_post_processors(config, pretrained_path=str(tmp_path))
    batch = pre({OBS_STATE: states(3)})
    torch.testing.assert_close(batch[OBS_STATE], states(3))  # physical units: nothing is normalised
    torch.testing.assert_close(post(torch.ones(3, 6)), torch.ones(3, 6))


@pytest.mark.parametrize("policy_type", ["spacedock_meta_rl", "spacedock_mpc"])
def test_pushed_and_fetched_from_a_hub_it_flies_the_same(policy_type, monkeypatch, tmp_path):
    from huggingface_hub import constants

    policy = build(policy_type)
    with LocalHub() as hub:
        monkeypatch.setattr(constants, "ENDPOINT", hub.url)
        monkeypatch.setattr(
            constants, "HUGGINGFACE_CO_URL_TEMPLATE", f"{hub.url}/{{repo_id}}/resolve/{{revision}}/{{filename}}"
        )
        monkeypatch.setattr(constants, "HF_HUB_DISABLE_XET", True)
        monkeypatch.setattr(constants, "HF_HUB_OFFLINE", False)
        monkeypatch.setenv("HF_TOKEN", TOKEN)
        policy.push_to_hub("test/expert", private=True)
        pushed = hub.repositories[("model", "test/expert")]
        assert pushed.private
        assert {name.rpartition(".")[2] for name in pushed.files("main")} == {"json", "safetensors"}
        fetched = type(policy).from_pretrained("test/expert", cache_dir=tmp_path)
    torch.testing.assert_close(fly(fetched), fly(policy), rtol=0, atol=0)


def test_the_saved_config_tells_the_port_and_the_attitude_model(tmp_path):
    build("spacedock_mpc", port="harmony_forward", hill_coupling=True).save_pretrained(tmp_path)
    saved = json.loads((tmp_path / "config.json").read_text())
    assert (saved["type"], saved["port"], saved["hill_coupling"]) == ("spacedock_mpc", "harmony_forward", True)


@pytest.mark.parametrize(
    ("flags", "port", "hill_coupling"),
    [
        (["--env.port=harmony_forward", "--env.task=SpaceDockContact-v0"], "harmony_forward", True),
        (["--env.task=SpaceDockContact-v0"], "zvezda_aft", True),
        (["--env.port=harmony_forward", "--policy.port=zvezda_aft"], "zvezda_aft", False),
        (["--policy.hill_coupling=true"], "zvezda_aft", True),
    ],
)
@pytest.mark.parametrize("saved", [{"port": "zvezda_aft", "hill_coupling": False}, {"port": "harmony_forward"}])
def test_a_saved_policy_flies_in_the_env_that_the_command_names(
    tmp_path, monkeypatch, saved, flags, port, hill_coupling
):
    build("spacedock_mpc", **saved).save_pretrained(tmp_path)
    monkeypatch.setattr("sys.argv", ["lerobot-eval", f"--policy.path={tmp_path}", "--env.type=spacedock", *flags])
    overrides = [flag.replace("--policy.", "--") for flag in flags if flag.startswith("--policy.")]
    config = PreTrainedConfig.from_pretrained(tmp_path, cli_overrides=overrides)
    assert (config.port, config.hill_coupling) == (port, hill_coupling)


@pytest.mark.parametrize(
    ("expert", "policy_type", "options"),
    [
        ("mpc_adaptive", "spacedock_mpc", {"mode": "receding"}),
        ("W_adaptive", "spacedock_feedback", {"law": "W"}),
    ],
)
def test_the_adaptive_experts_are_policy_types_too(expert, policy_type, options):
    adaptive, plain = build(policy_type, adaptive=True, **options), build(policy_type, **options)
    flown = fly(adaptive)
    law = make_expert(expert, TaskConfig())
    law.reset(3)
    named = [torch.from_numpy(law.act(states(3, seed).numpy())) for seed in (0, 1, 2)]
    torch.testing.assert_close(flown, torch.stack(named).float(), rtol=1e-5, atol=1e-5)
    assert not torch.allclose(flown[1:], fly(plain)[1:])  # from the second step on, thrust by the estimate


@pytest.mark.parametrize(("policy_type", "expert"), [("spacedock_mpc", "mpc_fixed"), ("spacedock_zem", "zem")])
def test_a_deadline_is_counted_in_the_steps_of_the_env_that_the_command_names(policy_type, expert, monkeypatch):
    task = TaskConfig(contact=True, hill_coupling=True, time_step="fixed", time_step_mean_s=0.7)
    arguments = ["--env.type=spacedock", "--env.task=SpaceDockContact-v0", "--env.time_step_mean_s=0.7"]
    monkeypatch.setattr("sys.argv", ["lerobot-eval", *arguments])
    policy = build(policy_type)
    observation = BatchedSpaceDock(4, task).reset(np.arange(4))
    law = make_expert(expert, task)
    law.reset(4), policy.reset()
    shown = {OBS_STATE: torch.from_numpy(observation.astype(np.float32))}
    np.testing.assert_allclose(policy.select_action(shown).numpy(), law.act(observation), rtol=1e-4, atol=1e-4)
    monkeypatch.setattr("sys.argv", ["lerobot-eval", *arguments, "--policy.deadline_step_s=0.9"])
    assert build(policy_type, deadline_step_s=0.9).config.deadline_step_s == 0.9
    monkeypatch.setattr("sys.argv", ["lerobot-eval", *arguments[:2], "--policy.path=saved"])
    assert build(policy_type, deadline_step_s=0.7).config.deadline_step_s == 0.907, "the env's, whatever was saved"
    monkeypatch.setattr("sys.argv", ["python"])
    assert build(policy_type).config.deadline_step_s == 0.907


@pytest.mark.parametrize("policy_type", ["spacedock_mpc", "spacedock_feedback"])
@pytest.mark.parametrize("step_s", [0.6, 1.5])
def test_the_estimate_counts_on_the_steps_of_the_env_that_the_command_names(policy_type, step_s, monkeypatch):
    """All of the commanded thrust acts, whatever the length of a step."""
    monkeypatch.setattr("sys.argv", ["lerobot-eval", "--env.type=spacedock", f"--env.time_step_mean_s={step_s}"])
    law = build(policy_type, adaptive=True).make_expert(torch.device("cpu"))
    batch = BatchedSpaceDock(4, TaskConfig(time_step="fixed", time_step_mean_s=step_s))
    observation = batch.reset(range(4))
    law.reset(4)
    for _ in range(10):
        observation = batch.step(law.act(observation)).observation
    law.act(observation)
    np.testing.assert_allclose(law.scale, 1.0, atol=0.02)


def test_weights_that_are_missing_are_an_error(tmp_path):
    policy = build("spacedock_meta_rl")
    policy.save_pretrained(tmp_path)
    from safetensors.torch import load_file, save_file

    weights = load_file(tmp_path / "model.safetensors")
    weights.pop("network.log_std")
    save_file(weights, tmp_path / "model.safetensors")
    with pytest.raises(RuntimeError, match=r"network\.log_std"):
        type(policy).from_pretrained(tmp_path)


def test_a_network_without_weights_does_not_fly():
    policy = build("spacedock_meta_rl", lstm_size=8, hidden_sizes=(8,))
    with pytest.raises(InputError, match="a trained network"):
        fly(policy)


def test_a_checkpoint_that_is_not_there_says_how_to_make_one(tmp_path):
    with pytest.raises(OptionError, match="spacedock train-expert"):
        build("spacedock_meta_rl", checkpoint=str(tmp_path / "policy.safetensors"))


@pytest.mark.parametrize("env", [{"obs_type": "pixels"}, {"task": "SpaceDockVision-v0"}])
def test_without_the_whole_state_an_expert_refuses(env):
    with pytest.raises(InputError, match="obs_type=agent_pos"):
        build("spacedock_mpc", env=env)


@pytest.mark.parametrize("option", ["--env.task=SpaceDockVision-v0", "--env.obs_type=pixels"])
def test_the_commands_env_is_looked_at_before_it_is_made(option, monkeypatch):
    monkeypatch.setattr("sys.argv", ["lerobot-eval", "--env.type=spacedock", option])
    with pytest.raises(OptionError, match="an env that shows the whole state"):
        make_policy_config("spacedock_mpc", device="cpu")


def test_another_action_size_is_refused():
    config = make_policy_config(
        "spacedock_mpc",
        device="cpu",
        input_features={OBS_STATE: PolicyFeature(FeatureType.STATE, (13,))},
        output_features={ACTION: PolicyFeature(FeatureType.ACTION, (7,))},
    )
    from lerobot_spacedock.adapters.policies.modeling_spacedock import SpaceDockMpcPolicy

    with pytest.raises(InputError, match=r"shape \(7,\)"):
        SpaceDockMpcPolicy(config)


@pytest.mark.parametrize("policy_type", TYPES)
def test_training_one_says_what_does_train_it(policy_type):
    policy = build(policy_type)
    for call in (policy.get_optim_params, lambda: policy.forward({})):
        with pytest.raises(SpaceDockError, match="spacedock train-expert"):
            call()


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("spacedock_mpc", {"mode": "fast"}),
        ("spacedock_mpc", {"closing_speed_m_s": -1.0}),
        ("spacedock_zem", {"deadline_steps": 0}),
        ("spacedock_feedback", {"law": "X"}),
    ],
)
def test_an_option_that_cannot_be_used_is_named_as_its_flag(kind, options):
    with pytest.raises(OptionError, match=next(iter(options))):
        PreTrainedConfig.get_choice_class(kind)(**options)
