"""The warm start: reading demonstrations, imitating them, and PPO going on without forgetting them at once."""

import json
import shutil

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
from torch.utils.tensorboard import SummaryWriter

from lerobot_spacedock.env.batch import BatchedSpaceDock
from lerobot_spacedock.episode_log import MAX_STATES
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.expert.demonstrations import find_dataset, load_demonstrations, teacher_counts
from lerobot_spacedock.expert.evaluate import TASKS
from lerobot_spacedock.expert.feedback import FeedbackPolicy
from lerobot_spacedock.expert.imitate import _sequences, freeze_actor, imitate
from lerobot_spacedock.expert.meta_rl import MetaRlPolicy
from lerobot_spacedock.expert.policy import action_signs, observation_signs
from lerobot_spacedock.expert.ppo import collect, make_ppo
from lerobot_spacedock.expert.train import _iterate, train_expert
from lerobot_spacedock.expert.train_config import ActorConfig, PpoConfig, TrainExpertConfig
from lerobot_spacedock.expert.train_state import export_actor
from lerobot_spacedock.expert.training_tasks import TrainingTasks
from lerobot_spacedock.physics.contact import HARMONY_FORWARD


def write_dataset(folder, episodes=24, steps=65, with_mass=False, version="v3.0"):
    """What the warm start reads of a LeRobotDataset, in two files, flown by the feedback law."""
    policy = FeedbackPolicy("W")
    batch = BatchedSpaceDock(episodes, TASKS["fixed random"])
    observation = batch.reset(np.arange(episodes))
    policy.reset(episodes)
    states, actions = [], []
    for _ in range(steps):
        actions.append(policy.act(observation))
        states.append(np.insert(observation, 6, 1000.0, axis=1) if with_mass else observation)
        observation = batch.step(actions[-1]).observation
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps({"codebase_version": version}))
    for part, rows in enumerate(np.array_split(np.arange(episodes), 2)):
        table = {"observation.state": [], "action": [], "episode_index": [], "frame_index": []}
        for row in rows:
            for step in range(steps):
                table["observation.state"].append(states[step][row].tolist())
                table["action"].append(actions[step][row].tolist())
                table["episode_index"].append(int(row))
                table["frame_index"].append(step)
        path = folder / "data" / "chunk-000" / f"file-{part:03d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(pa.table(table), path)
    return np.array(states), np.array(actions)


def small(folder, **changes):
    options = {
        "output_dir": str(folder / "out"),
        "init_from": str(folder / "demos"),
        "interactions": 16 * 20 * 3,
        "num_envs": 16,
        "episode_steps": 20,
        "evaluate_every": 100,
        "evaluation_episodes": 2,
        "init_critic_iterations": 1,
        "ppo": PpoConfig(epochs=1, mini_batches=2, critic_hidden_sizes=[16]),
        "actor": ActorConfig(lstm_size=32, hidden_sizes=[32], thrust_limit_N=60.0),
    }
    return TrainExpertConfig(**(options | changes))


@pytest.mark.parametrize("with_mass", [False, True])
def test_demonstrations_are_read_in_order_whatever_the_files(tmp_path, with_mass):
    states, actions = write_dataset(tmp_path / "demos", episodes=5, steps=7, with_mass=with_mass)
    episodes = load_demonstrations(find_dataset(str(tmp_path / "demos")))
    assert len(episodes) == 5
    for row, (observation, command) in enumerate(episodes):
        expected = np.delete(states[:, row], 6, axis=1) if with_mass else states[:, row]
        np.testing.assert_allclose(observation, expected, rtol=1e-6)
        np.testing.assert_allclose(command, actions[:, row], rtol=1e-6)


def test_imitation_learns_the_teacher(tmp_path):
    write_dataset(tmp_path / "demos")
    config = small(tmp_path, init_epochs=150)
    algorithm = make_ppo(config, TrainingTasks(config).reset(0))
    account = imitate(config, algorithm)
    assert account["demonstration_frames"] == 24 * 65
    assert account["imitation_s"] > 0.0
    policy = MetaRlPolicy(export_actor(config, algorithm))
    # flown on starts that it has not seen, by the teacher; what would the student have done?
    teacher = FeedbackPolicy("W")
    batch = BatchedSpaceDock(16, TASKS["fixed random"])
    observation = batch.reset(np.arange(500, 516))
    teacher.reset(16), policy.reset(16)
    wrong, size = [], []
    for _ in range(65):
        command, copied = teacher.act(observation), policy.act(observation)
        wrong.append((command - copied)[:, :3])
        size.append(command[:, :3] - command[:, :3].mean())
        observation = batch.step(command).observation
    assert np.square(wrong).mean() < 0.2 * np.square(size).mean()


def test_the_critic_learns_first(tmp_path):
    write_dataset(tmp_path / "demos", episodes=4, steps=10)
    config = small(tmp_path, init_epochs=2)
    tasks = TrainingTasks(config)
    algorithm = make_ppo(config, tasks.reset(0))
    imitate(config, algorithm)

    def one_update(frozen):
        """The names of what changed in the actor."""
        before = {name: value.clone() for name, value in algorithm.actor.state_dict().items()}
        critic = algorithm.critic.mlp[0].weight.clone()
        freeze_actor(algorithm, frozen)
        collect(algorithm, tasks, 0, config.episode_steps)
        algorithm.update()
        assert not torch.equal(critic, algorithm.critic.mlp[0].weight)
        return {name for name, value in algorithm.actor.state_dict().items() if not torch.equal(value, before[name])}

    assert one_update(True) == set()
    changed = one_update(False)
    assert any(name.startswith("mlp.") for name in changed)
    assert not any("normalizer" in name for name in changed)  # behind which the weights were fitted


def test_a_training_that_starts_from_demonstrations(tmp_path):
    write_dataset(tmp_path / "demos", episodes=4, steps=10)
    train_expert(small(tmp_path, init_epochs=2))
    account = json.loads((tmp_path / "out" / "training.json").read_text())
    assert account["demonstration_frames"] == 40
    assert account["interactions"] == 960 + 40
    assert account["earlier_episodes"] == 4


def test_the_critic_learns_at_a_rate_that_is_not_the_actors(tmp_path):
    write_dataset(tmp_path / "demos", episodes=4, steps=10)
    config = small(tmp_path, init_epochs=2, ppo=PpoConfig(epochs=4, mini_batches=2, learning_rate=1e-2))
    tasks = TrainingTasks(config)
    algorithm = make_ppo(config, tasks.reset(0))
    progress = {"iteration": 0, "episodes": 0, "interactions": 0, "collect_s": 0.0, "learn_s": 0.0}
    progress |= {"smoothness_price": 1.0} | imitate(config, algorithm)
    moved = []
    with SummaryWriter(str(tmp_path / "log")) as writer:
        for _ in range(config.init_critic_iterations + 1):
            before = algorithm.actor.mlp[0].weight.clone()
            _iterate(config, algorithm, tasks, progress, writer)
            moved.append((algorithm.actor.mlp[0].weight - before).abs().max().item())
    assert moved[0] == 0.0
    # eight updates of Adam, the first at 1e-5, none more than 1.5 times the one before it
    assert 0.0 < moved[1] < 1e-5 * sum(1.5**k for k in range(8)) * 1.5


@pytest.mark.parametrize(
    ("facts", "counts"),
    [
        ({}, (0, 0)),
        ({"expert": {"name": "W", "training": None}}, (0, 0)),
        ({"expert": {"name": "meta_rl", "training": {"episodes": 7, "interactions": 560}}}, (7, 560)),
        ({"expert": {"training": ["much"]}}, None),
        ({"expert": {"training": {"episodes": "many"}}}, None),
    ],
)
def test_what_the_teacher_had_cost_is_what_the_dataset_says(tmp_path, facts, counts):
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "spacedock.json").write_text(json.dumps(facts))
    if counts is None:
        with pytest.raises(FileFormatError, match=r"spacedock\.json"):
            teacher_counts(tmp_path)
    else:
        assert tuple(teacher_counts(tmp_path).values()) == counts


def test_a_mistyped_start_leaves_no_folder_behind(tmp_path):
    with pytest.raises(InputError, match="a checkpoint of another training"):
        train_expert(small(tmp_path, init_from=str(tmp_path / "nothing")))
    assert not (tmp_path / "out").exists()


def test_what_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path))
    with pytest.raises(InputError, match=r"meta/info.json"):
        find_dataset("nobody/nothing")
    write_dataset(tmp_path / "old", episodes=2, steps=3, version="v2.1")
    assert find_dataset("old") == tmp_path / "old"
    with pytest.raises(FileFormatError, match=r"v2.1"):
        load_demonstrations(tmp_path / "old")
    write_dataset(tmp_path / "short", episodes=2, steps=3)
    file = next((tmp_path / "short" / "data").rglob("*.parquet"))
    table = pq.read_table(file)
    short = [row[:5] for row in table["action"].to_pylist()]
    for other in (tmp_path / "short" / "data").rglob("*.parquet"):
        pq.write_table(table.set_column(1, "action", pa.array(short)), other)
    with pytest.raises(FileFormatError, match="action of 5 values"):
        load_demonstrations(tmp_path / "short")
    pq.write_table(table.drop_columns(["action"]), file)
    with pytest.raises(FileFormatError, match=r"columns \['action'\] are missing"):
        load_demonstrations(tmp_path / "short")
    uneven = [[0.0] * 4, [0.0] * 8, *[[0.0] * 6] * (table.num_rows - 2)]  # as many numbers as six a row would be
    pq.write_table(table.set_column(1, "action", pa.array(uneven)), file)
    with pytest.raises(FileFormatError, match="different lengths"):
        load_demonstrations(tmp_path / "short")


def test_a_file_that_repeats_its_rows_is_refused_before_it_is_held(tmp_path):
    write_dataset(tmp_path / "long", episodes=2, steps=3)
    file = next((tmp_path / "long" / "data").rglob("*.parquet"))
    row = pq.read_table(file).slice(0, 1)
    repeated = {name: pa.repeat(row.column(name)[0], MAX_STATES + 1) for name in row.column_names}
    pq.write_table(pa.table(repeated), file)
    with pytest.raises(FileFormatError, match=r"episode \d has more than 1,000,000 rows"):
        load_demonstrations(tmp_path / "long")


def test_demonstrations_at_harmony_are_seen_as_at_zvezda(tmp_path):
    write_dataset(tmp_path / "aft", episodes=2, steps=5)
    shutil.copytree(tmp_path / "aft", tmp_path / "forward")
    for file in (tmp_path / "forward" / "data").rglob("*.parquet"):
        table = pq.read_table(file)
        for name, signs in (("observation.state", observation_signs), ("action", action_signs)):
            mirrored = np.stack(table[name].to_numpy()) * signs(HARMONY_FORWARD)
            table = table.set_column(table.column_names.index(name), name, pa.array(mirrored.tolist()))
        pq.write_table(table, file)
    facts = {"env": {"port": "harmony_forward"}}
    (tmp_path / "forward" / "meta" / "spacedock.json").write_text(json.dumps(facts))
    aft, forward = (_sequences(small(tmp_path, init_from=str(tmp_path / name)), "cpu") for name in ("aft", "forward"))
    for one, other in zip(aft, forward, strict=True):
        torch.testing.assert_close(one, other)
