"""The training: advantages by hand, memory between episodes, seeds, exact resume, and what is refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from rsl_rl.algorithms import PPO
from safetensors.torch import load_file

from lerobot_spacedock.env.reward_config import RewardConfig
from lerobot_spacedock.env.scenario_config import MetaRanges
from lerobot_spacedock.errors import FileFormatError, InputError, SimulationError
from lerobot_spacedock.expert.checkpoint import load_actor, training_counts
from lerobot_spacedock.expert.ppo import clear_memory, collect, make_ppo, set_std_ceiling
from lerobot_spacedock.expert.train import desired_kl, mean_change_coef, smoothness_weight, std_ceiling, train_expert
from lerobot_spacedock.expert.train_config import (
    ActorConfig,
    PpoConfig,
    ShoveConfig,
    TaskShare,
    TrainExpertConfig,
)
from lerobot_spacedock.expert.train_state import checkpoints, export_actor, load_networks
from lerobot_spacedock.expert.training_tasks import TRAINING_SEEDS_FROM, TrainingTasks
from lerobot_spacedock.files import aside
from lerobot_spacedock.folders import only_process


def small(folder: Path, **changes) -> TrainExpertConfig:
    options = {
        "output_dir": str(folder),
        "interactions": 4 * 8 * 10,
        "num_envs": 8,
        "episode_steps": 10,
        "checkpoint_every": 1,
        "evaluate_every": 100,
        "evaluation_episodes": 2,
        "ppo": PpoConfig(epochs=2, mini_batches=2, critic_hidden_sizes=[16]),
        "actor": ActorConfig(lstm_size=8, hidden_sizes=[8]),
    }
    return TrainExpertConfig(**(options | changes))


@pytest.fixture
def parts(tmp_path):
    config = small(tmp_path)
    tasks = TrainingTasks(config)
    return config, tasks, make_ppo(config, tasks.reset(0))


def test_advantages_by_hand(parts):
    config, tasks, algorithm = parts
    collect(algorithm, tasks, 0, config.episode_steps)
    storage, gamma, lam = algorithm.storage, 0.99, 0.95
    reward, value = storage.rewards[:, 3, 0].double().numpy(), storage.values[:, 3, 0].double().numpy()
    # the sum of the definition, term by term: Σ (γλ)^l (r + γ V' − V); the cut's bootstrap is in the last reward
    delta = [reward[k] + (gamma * value[k + 1] if k + 1 < len(reward) else 0.0) - value[k] for k in range(len(reward))]
    advantage = [sum((gamma * lam) ** j * delta[k + j] for j in range(len(reward) - k)) for k in range(len(reward))]
    np.testing.assert_allclose(storage.returns[:, 3, 0], np.array(advantage) + value, rtol=1e-4)


def test_the_cut_at_the_end_is_worth_what_would_follow(parts):
    config, tasks, algorithm = parts
    with torch.no_grad():  # a critic that says 7 everywhere
        for parameter in algorithm.critic.mlp[-1].parameters():
            parameter.zero_()
        algorithm.critic.mlp[-1].bias.fill_(7.0)
    seen = []
    step = tasks.step
    tasks.step = lambda output: seen.append(step(output)) or seen[-1]
    collect(algorithm, tasks, 0, config.episode_steps)
    plain = torch.stack([reward for _, reward in seen])
    torch.testing.assert_close(algorithm.storage.rewards[:-1, :, 0], plain[:-1])
    torch.testing.assert_close(algorithm.storage.rewards[-1, :, 0], plain[-1] + 0.99 * 7.0)
    assert algorithm.storage.dones[-1].all()
    assert not algorithm.storage.dones[:-1].any()


def test_memory_is_empty_at_the_start_of_every_episode_and_only_there(parts):
    config, tasks, algorithm = parts
    for iteration in range(2):
        algorithm.storage.clear()
        collect(algorithm, tasks, iteration, config.episode_steps)
        for state in algorithm.storage.saved_hidden_state_a:
            assert (state[0] == 0.0).all()
            assert (state[1:].abs().amax(dim=(1, 3)) > 0.0).all()


def test_the_update_sees_the_sequences_that_were_flown(parts):
    # means recomputed from whole sequences are the means flown: memory, order and masks are right
    config, tasks, algorithm = parts
    collect(algorithm, tasks, 0, config.episode_steps)
    batch = next(algorithm.storage.recurrent_mini_batch_generator(2, 1))
    with torch.no_grad():
        algorithm.actor(
            batch.observations, masks=batch.masks, hidden_state=batch.hidden_states[0], stochastic_output=True
        )
    torch.testing.assert_close(algorithm.actor.output_mean, batch.old_distribution_params[0], atol=1e-5, rtol=1e-4)


def test_no_episode_ends_early_and_rewards_are_finite(parts):
    config, tasks, _ = parts
    tasks.reset(0)
    for _ in range(config.episode_steps):
        observations, reward = tasks.step(torch.full((config.num_envs, 6), 5.0))
        assert torch.isfinite(reward).all()
        assert torch.isfinite(observations["critic"]).all()


def test_the_last_action_is_what_flew_not_what_was_wanted(parts):
    config, tasks, _ = parts
    assert (tasks.reset(0)["actor"][:, 15:] == 0.0).all()
    observations, _ = tasks.step(torch.full((config.num_envs, 6), 100.0))
    scale = torch.tensor([40.0] * 3 + [1.5] * 3)
    limits = torch.tensor([40.0] * 3 + [20.0] * 3)
    torch.testing.assert_close(observations["actor"][0, 15:], limits / scale)


def test_smoothness_costs_the_norm_of_the_change_from_the_second_step_on(tmp_path):
    one_task = [TaskShare(1.0, "same", "nominal", False)]
    commands = [torch.zeros(8, 6), torch.tensor([0.5, 0, 0, 0, 0, 0.0]).repeat(8, 1)]
    rewards = []
    for weight in (0.0, 0.2):
        tasks = TrainingTasks(small(tmp_path, tasks=one_task))
        tasks.smoothness_weight = weight
        tasks.reset(0)
        rewards.append([tasks.step(command)[1] for command in commands])
    torch.testing.assert_close(rewards[0][0], rewards[1][0])
    torch.testing.assert_close(rewards[0][1] - rewards[1][1], torch.full((8,), 0.1 * 0.2 * 20.0), atol=1e-6, rtol=0)


def test_shoves_move_only_the_share_that_gets_them(tmp_path):
    def states(shoved):
        shares = [TaskShare(0.5, "same", "nominal", False, shoves=shoved), TaskShare(0.5, "same", "nominal", False)]
        tasks = TrainingTasks(small(tmp_path, tasks=shares))
        tasks.reset(0)
        for _ in range(10):
            tasks.step(torch.zeros(8, 6))
        return [batch.sim.state.copy() for batch in tasks._batches]

    calm, rough = states(False), states(True)
    np.testing.assert_array_equal(calm[1], rough[1])
    assert np.abs(calm[0] - rough[0])[:, 3:6].max() > 1e-3


def test_training_tasks_differ_by_iteration_seed_and_row_and_stay_clear_of_evaluation_seeds(tmp_path):
    config = small(tmp_path)
    first = TrainingTasks(config).reset(0)["actor"]
    assert len(first.unique(dim=0)) == config.num_envs
    torch.testing.assert_close(first, TrainingTasks(config).reset(0)["actor"], rtol=0, atol=0)
    assert (first != TrainingTasks(config).reset(1)["actor"]).any(dim=1).all()
    assert (first != TrainingTasks(replace(config, seed=1)).reset(0)["actor"]).any(dim=1).all()
    assert TRAINING_SEEDS_FROM > 10**12


def weights(folder):
    return load_file(Path(folder) / "policy.safetensors")


def test_same_seed_reproduces_and_another_diverges(tmp_path):
    for name, seed in (("a", 0), ("b", 0), ("c", 1)):
        train_expert(small(tmp_path / name, seed=seed))
    a, b, c = (weights(tmp_path / name) for name in "abc")
    assert all(torch.equal(a[key], b[key]) for key in a)
    assert any(not torch.equal(a[key], c[key]) for key in a)


def test_resume_is_exact(tmp_path):
    train_expert(small(tmp_path / "whole"))
    train_expert(small(tmp_path / "parts", stop_after=2))
    # what was written after the last checkpoint, or half of it, does not matter
    (tmp_path / "parts" / "checkpoints" / ".000003.part").mkdir()
    torch.manual_seed(12345)
    train_expert(small(tmp_path / "parts", resume=True))
    whole, parts = weights(tmp_path / "whole"), weights(tmp_path / "parts")
    assert all(torch.equal(whole[key], parts[key]) for key in whole)
    states = [
        load_file(checkpoints(tmp_path / n / "checkpoints")[-1] / "training.safetensors") for n in ("whole", "parts")
    ]
    assert all(torch.equal(states[0][key], states[1][key]) for key in states[0])
    account = json.loads((tmp_path / "parts" / "training.json").read_text())
    assert account["interactions"] == 320
    assert account["episodes"] == 32


def test_evaluation_does_not_change_the_training(tmp_path):
    train_expert(small(tmp_path / "often", evaluate_every=1))
    train_expert(small(tmp_path / "once"))
    often, once = weights(tmp_path / "often"), weights(tmp_path / "once")
    assert all(torch.equal(often[key], once[key]) for key in often)
    curve = json.loads((tmp_path / "often" / "training.json").read_text())["curve"]
    assert [point["interactions"] for point in curve] == [0, 80, 160, 240, 320]


def test_feed_forward_actor_trains_and_flies(tmp_path):
    config = small(tmp_path / "ff", actor=ActorConfig(lstm_size=0, hidden_sizes=[8, 8]), stop_after=1)
    train_expert(config)
    network, description = load_actor(tmp_path / "ff" / "policy.safetensors")
    assert network.lstm is None
    assert description["training"]["interactions"] == 80


def test_the_exported_actor_is_the_trained_one(parts):
    config, tasks, algorithm = parts
    collect(algorithm, tasks, 0, config.episode_steps)
    algorithm.update()
    observations = tasks.reset(5)
    clear_memory(algorithm, config.num_envs)
    algorithm.actor.eval()
    with torch.no_grad():
        mean, _ = export_actor(config, algorithm)(observations["actor"])
        torch.testing.assert_close(mean, algorithm.actor(observations), atol=1e-6, rtol=1e-5)


def test_schedules():
    config = TrainExpertConfig(smoothness_start=0.001, smoothness_ramp=0.5)
    final = config.reward.smoothness
    assert smoothness_weight(config, 0.0) == pytest.approx(0.001)
    assert smoothness_weight(config, 0.25) == pytest.approx((0.001 * final) ** 0.5)
    assert smoothness_weight(config, 0.9) == pytest.approx(final)
    config = replace(config, ppo=PpoConfig(desired_kl=0.01, final_desired_kl=0.0025))
    assert desired_kl(config, 0.3) == pytest.approx(0.01)
    assert desired_kl(config, 0.75) == pytest.approx(0.005)
    assert desired_kl(config, 1.0) == pytest.approx(0.0025)
    config = replace(config, ppo=PpoConfig(mean_change_coef=0.2, mean_change_from=0.3))
    assert mean_change_coef(config, 0.3) == 0.0
    assert mean_change_coef(config, 0.4) == pytest.approx(0.1)
    assert mean_change_coef(config, 0.8) == pytest.approx(0.2)


def test_killed_before_its_first_checkpoint_it_starts_again_with_the_same_command(tmp_path):
    whole, cut = small(tmp_path / "whole", interactions=2 * 8 * 10), small(tmp_path / "cut", interactions=2 * 8 * 10)
    train_expert(whole)
    (tmp_path / "cut").mkdir()
    with aside(tmp_path / "cut" / "config.json") as half:
        half.write_text("{")
    (tmp_path / "cut" / "config.json").rename(half)  # what a kill at the very start leaves
    with pytest.raises(InputError, match="--resume=true"):
        train_expert(cut)
    train_expert(replace(cut, resume=True))
    assert all(torch.equal(a, weights(tmp_path / "cut")[key]) for key, a in weights(tmp_path / "whole").items())


def test_two_trainings_do_not_share_a_folder(tmp_path):
    with only_process(tmp_path / "a", "--output_dir"), pytest.raises(InputError, match="no other process is writing"):
        train_expert(small(tmp_path / "a"))


def test_what_is_refused(tmp_path):
    train_expert(small(tmp_path / "done", stop_after=1))
    with pytest.raises(InputError, match="does not exist yet"):
        train_expert(small(tmp_path / "done"))
    with pytest.raises(InputError, match="output_dir of a training"):
        train_expert(small(tmp_path / "none", resume=True))
    with pytest.raises(FileFormatError, match="num_envs"):
        train_expert(small(tmp_path / "done", resume=True, num_envs=16))
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"--output_dir: got .*file; allowed: a folder"):
        train_expert(small(tmp_path / "file"))
    begun = tmp_path / "begun"  # and killed before its first checkpoint
    begun.mkdir()
    (begun / "config.json").write_text((tmp_path / "done" / "config.json").read_text())
    with pytest.raises(FileFormatError, match="another configuration"):
        train_expert(small(begun, resume=True, seed=5))
    if not torch.cuda.is_available():
        with pytest.raises(InputError, match="of a GPU that torch sees"):
            train_expert(small(tmp_path / "gpu", device="cuda"))
    with pytest.raises(InputError, match="of a GPU that torch sees"):
        train_expert(small(tmp_path / "gpu", device="gpu"))
    newest = checkpoints(tmp_path / "done" / "checkpoints")[-1]
    (newest / "training.safetensors").write_bytes(b"\x80\x04pickle")
    with pytest.raises(FileFormatError, match="not readable as a safetensors file"):
        train_expert(small(tmp_path / "done", resume=True))
    for wrong, said in [
        ({"tasks": [TaskShare(0.5)]}, "add up to"),
        ({"num_envs": 9}, "multiple"),
        ({"interactions": 0}, "≥ 1"),
        ({"smoothness_ramp": 1.5}, "fraction"),
        ({"seed": -1}, "seed: got -1; allowed: an integer from 0"),
        ({"seed": 2**63}, "seed: got 9223372036854775808; allowed: an integer from 0"),
        ({"num_envs": 4, "tasks": [TaskShare(0.95), TaskShare(0.05)]}, "a share of 0.05 has one at least"),
        ({"init_std": 0.3}, "--init_std: got 0.3; allowed: the default, without --init_from"),
        ({"reward": RewardConfig(terminal=1.0)}, "--reward.terminal: got 1.0; allowed: the default, 20"),
        ({"shoves": ShoveConfig(0.5), "tasks": [TaskShare()]}, "--shoves: .*without a task with shoves"),
        ({"meta": MetaRanges(mass_fraction=0.4), "tasks": [TaskShare(dynamics="nominal")]}, "a task with dynamics"),
        ({"meta": MetaRanges(mass_fraction=1.5)}, r"meta\.mass_fraction: got 1\.5"),
        ({"reward": RewardConfig(rate_scale_deg_s=0.0)}, r"reward\.rate_scale_deg_s: got 0\.0"),
        ({"evaluation_episodes": 0}, "evaluation_episodes: got 0; allowed: an integer ≥ 1"),
    ]:
        with pytest.raises(InputError, match=said):
            small(tmp_path, **wrong)


@pytest.mark.parametrize(
    ("group", "wrong", "said"),
    [
        (PpoConfig, {"mini_batches": 0}, "ppo.mini_batches: got 0; allowed: an integer ≥ 1"),
        (PpoConfig, {"epochs": 0}, "ppo.epochs: got 0"),
        (PpoConfig, {"learning_rate": float("nan")}, "ppo.learning_rate: got nan; allowed: a number > 0"),
        (PpoConfig, {"final_std_ceiling": 0.0}, "ppo.final_std_ceiling: got 0.0"),
        (PpoConfig, {"gamma": 1.01}, "ppo.gamma: got 1.01; allowed: from 0 to 1"),
        (PpoConfig, {"critic_hidden_sizes": []}, "ppo.critic_hidden_sizes: got []"),
        (ActorConfig, {"initial_std": 0.0}, "actor.initial_std: got 0.0"),
        (ActorConfig, {"hidden_sizes": [0]}, "actor.hidden_sizes: got [0]"),
        (ShoveConfig, {"probability": 2.0}, "shoves.probability: got 2.0; allowed: from 0 to 1"),
    ],
)
def test_a_training_that_cannot_run_is_refused_before_it_starts(group, wrong, said):
    with pytest.raises(InputError) as error:
        group(**wrong)
    assert said in str(error.value)


def test_without_its_extra_term_the_update_is_rsl_rls(tmp_path):
    def updated(plain):
        config = small(tmp_path, ppo=PpoConfig(epochs=2, mini_batches=2, critic_hidden_sizes=[16]))
        tasks = TrainingTasks(config)
        algorithm = make_ppo(config, tasks.reset(0))
        algorithm.mean_change_coef = 0.0
        collect(algorithm, tasks, 0, config.episode_steps)
        PPO.update(algorithm) if plain else algorithm.update()
        return algorithm

    theirs, ours = updated(True), updated(False)
    assert ours.learning_rate == theirs.learning_rate
    for model in ("actor", "critic"):
        for name, value in getattr(theirs, model).state_dict().items():
            torch.testing.assert_close(getattr(ours, model).state_dict()[name], value, atol=1e-6, rtol=1e-4)


@pytest.mark.parametrize("lstm_size", [8, 0])
def test_mean_change_is_eq_4_of_the_mean_command_and_can_be_learnt_away(tmp_path, lstm_size):
    config = small(tmp_path, actor=ActorConfig(lstm_size=lstm_size, hidden_sizes=[8]))

    def trained(coef, iterations):
        tasks = TrainingTasks(config)
        algorithm = make_ppo(config, tasks.reset(0))
        algorithm.mean_change_coef, algorithm.action_limits = coef, torch.full((6,), 1e9)
        for iteration in range(iterations):
            collect(algorithm, tasks, iteration, config.episode_steps)
            flown = algorithm.storage.distribution_params[0].clone()
            change = algorithm.update()["mean_change"]
        return flown, change

    # by hand from the means that were stored while flying; the first update has hardly moved them
    mean = trained(0.0, 1)[0] * torch.tensor([40.0] * 3 + [1.5] * 3)
    expected = (mean[1:] - mean[:-1]).norm(dim=-1).mean().item()
    assert trained(0.0, 1)[1] == pytest.approx(expected, rel=0.1)
    assert trained(10.0, 25)[1] < 0.5 * trained(0.0, 25)[1]


def test_exploration_has_a_ceiling(parts):
    config, tasks, algorithm = parts
    set_std_ceiling(algorithm, 0.01)
    collect(algorithm, tasks, 0, config.episode_steps)
    assert algorithm.storage.distribution_params[1].max() == pytest.approx(0.01)
    assert std_ceiling(config, 0.0) == pytest.approx(config.actor.initial_std)
    assert std_ceiling(config, config.smoothness_ramp) == pytest.approx(config.ppo.std_ceiling)
    assert std_ceiling(config, 1.0) == pytest.approx(config.ppo.final_std_ceiling)


def test_a_second_stage_starts_from_the_networks_of_the_first(tmp_path):
    train_expert(small(tmp_path / "first"))
    first = checkpoints(tmp_path / "first" / "checkpoints")[-1]
    config = small(tmp_path / "second", init_from=str(first))
    algorithm = make_ppo(config, TrainingTasks(config).reset(0))
    earlier = load_networks(config, algorithm)
    assert earlier == {"earlier_episodes": 32, "earlier_interactions": 320}
    exported = export_actor(config, algorithm).state_dict()
    assert all(torch.equal(value, exported[name]) for name, value in weights(first).items())
    train_expert(config)
    account = json.loads((tmp_path / "second" / "training.json").read_text())
    assert account["interactions"] == 640  # the first stage's with its own
    assert account["earlier_interactions"] == 320
    assert account["demonstration_frames"] == 0
    assert training_counts("meta_rl", tmp_path / "second") == {"episodes": 64, "interactions": 640}
    other = small(tmp_path / "third", init_from=str(first), actor=ActorConfig(lstm_size=4, hidden_sizes=[8]))
    with pytest.raises(FileFormatError, match="networks of the configured shape"):
        train_expert(other)
    assert not (tmp_path / "third").exists()
    units = ActorConfig(lstm_size=8, hidden_sizes=[8], thrust_scale_N=4.0)
    with pytest.raises(InputError, match=r"--actor.thrust_scale_N: got 4.0; allowed: 40, that of --init_from"):
        train_expert(small(tmp_path / "third", init_from=str(first), actor=units))


def test_a_second_stage_goes_on_though_the_first_is_gone(tmp_path):
    train_expert(small(tmp_path / "first"))
    first = checkpoints(tmp_path / "first" / "checkpoints")[-1]
    whole, cut = (small(tmp_path / name, init_from=str(first)) for name in ("whole", "cut"))
    train_expert(whole)
    train_expert(replace(cut, stop_after=2))
    shutil.rmtree(first)
    train_expert(replace(cut, resume=True))
    assert all(torch.equal(a, weights(tmp_path / "cut")[key]) for key, a in weights(tmp_path / "whole").items())


def test_a_diverged_training_is_told_of(tmp_path):
    with pytest.raises(SimulationError, match=r"iteration \d, seed 0: the networks' weights are not finite"):
        train_expert(small(tmp_path / "out", ppo=PpoConfig(mini_batches=2, learning_rate=1e30)))
