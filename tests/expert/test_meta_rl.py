"""The learnt expert: its network against rsl_rl's, its memory, its checkpoint, and that it docks."""

import json

import numpy as np
import pytest
import torch
from rsl_rl.models import MLPModel, RNNModel
from tensordict import TensorDict

from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.expert.checkpoint import (
    GENTLE,
    HOLD,
    NAMED,
    find_checkpoint,
    load_actor,
    save_actor,
    training_counts,
)
from lerobot_spacedock.expert.evaluate import HELD_OUT_SEED, TASKS, fly
from lerobot_spacedock.expert.features import FEATURE_DIM, actor_features
from lerobot_spacedock.expert.meta_rl import MetaRlPolicy
from lerobot_spacedock.expert.network import ActorNetwork, NetworkConfig
from lerobot_spacedock.physics.contact import ZVEZDA_AFT

NOMINAL = torch.tensor(ZVEZDA_AFT.q_nominal, dtype=torch.float32)


def observations(count, seed=0):
    rng = np.random.default_rng(seed)
    q = rng.normal(size=(count, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    parts = [rng.normal(size=(count, 3)) * 10, rng.normal(size=(count, 3)), q, rng.normal(size=(count, 3))]
    return np.concatenate(parts, axis=1).astype(np.float32)


def test_features_of_a_turn_that_is_known_by_hand():
    # 2 degrees about body y from the nominal attitude, both signs of the quaternion; 1 deg/s; a metre away
    half = np.deg2rad(1.0)
    a, b = np.array(ZVEZDA_AFT.q_nominal), np.array([np.cos(half), 0.0, np.sin(half), 0.0])
    turned = [
        a[0] * b[0] - a[1:] @ b[1:],
        *(a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])),
    ]
    row = np.array([0.0, -1.0, 0.0, 0.0, 0.2, 0.0, *turned, 1.0, 0.0, 0.0])
    other = row.copy()
    other[6:10] *= -1
    features = actor_features(torch.tensor(np.array([row, other]), dtype=torch.float32), torch.zeros(2, 6), NOMINAL)
    np.testing.assert_allclose(features[0], features[1], atol=1e-6)
    expected = [0, -1, 0, 0, np.tanh(-1), 0, 0, 1, 0, 0, 20 * np.sin(half), 0, 50 * np.deg2rad(1.0), 0, 0]
    np.testing.assert_allclose(features[0, :15], expected, atol=1e-5)


@pytest.mark.parametrize("recurrent", [True, False])
def test_the_plain_network_is_rsl_rls_model(recurrent):
    torch.manual_seed(1)
    group = TensorDict({"actor": torch.zeros(3, FEATURE_DIM)}, batch_size=[3])
    distribution = {"class_name": "GaussianDistribution", "init_std": 0.3, "std_type": "log"}
    common = (group, {"actor": ["actor"]}, "actor", 6, [32, 16], "elu", True, distribution)
    theirs = RNNModel(*common, rnn_type="lstm", rnn_hidden_dim=24) if recurrent else MLPModel(*common)
    theirs.update_normalization(TensorDict({"actor": 3.0 * torch.randn(50, FEATURE_DIM) + 1.0}, batch_size=[50]))
    theirs.eval()
    ours = ActorNetwork(NetworkConfig(lstm_size=24 if recurrent else 0, hidden_sizes=(32, 16)))
    ours.load_rsl_rl(theirs.state_dict())
    memory = None
    for step in range(5):
        features = torch.randn(3, FEATURE_DIM, generator=torch.Generator().manual_seed(step))
        mean, memory = ours(features, memory)
        expected = theirs(TensorDict({"actor": features}, batch_size=[3]))
        torch.testing.assert_close(mean, expected, atol=1e-6, rtol=1e-5)
    torch.testing.assert_close(ours.log_std.exp(), torch.full((6,), 0.3))


def test_reset_forgets_and_rows_do_not_touch_each_other():
    policy = MetaRlPolicy.load()
    sequence = [observations(4, seed) for seed in range(6)]
    policy.reset(4)
    first = [policy.act(o) for o in sequence]
    policy.reset(4)
    again = [policy.act(o) for o in sequence]
    np.testing.assert_array_equal(first, again)
    policy.reset(1)
    alone = [policy.act(o[2:3]) for o in sequence]
    np.testing.assert_allclose(np.array(first)[:, 2], np.array(alone)[:, 0], atol=1e-4)
    # and there is something to forget
    policy.reset(4)
    assert np.abs(policy.act(sequence[3]) - first[3]).max() > 1e-3


def test_forgetful_policy_has_no_memory_but_its_last_action():
    policy = MetaRlPolicy.load(forgetful=True)
    policy.reset(2)
    policy.act(observations(2, 0))
    second = policy.act(observations(2, 1))
    network = load_actor()[0]
    whole = MetaRlPolicy(network)
    whole.reset(2)
    last = torch.from_numpy(policy_output(network, observations(2, 0), torch.zeros(2, 6)))
    expected = policy_output(network, observations(2, 1), last) * network.config.action_scale.numpy()
    np.testing.assert_allclose(second, expected, atol=1e-4)


def policy_output(network, observation, last):
    output, _ = network(actor_features(torch.from_numpy(observation), last, NOMINAL))
    limits = network.config.action_limits / network.config.action_scale
    return torch.clamp(output, -limits, limits).detach().numpy()


def test_sampling_has_the_trained_spread_and_its_own_generator():
    network, _ = load_actor()
    observation = np.tile(observations(1), (4000, 1)) * np.array([0.1] * 6 + [1.0] * 4 + [0.1] * 3, dtype=np.float32)
    observation[:, 6:10] = ZVEZDA_AFT.q_nominal

    def first_actions(seed):
        policy = MetaRlPolicy(network, stochastic=True, seed=seed)
        policy.reset(len(observation))
        return policy.act(observation)

    actions = first_actions(5)
    expected = (network.log_std.exp() * network.config.action_scale).numpy()
    free = np.abs(actions).max(axis=0) < network.config.action_limits.numpy()
    assert free.sum() >= 3
    np.testing.assert_allclose(actions.std(axis=0)[free], expected[free], rtol=0.06)
    np.testing.assert_array_equal(actions, first_actions(5))
    assert np.abs(actions - first_actions(6)).max() > 0.0


def test_save_and_load_give_the_same_policy(tmp_path):
    network, description = load_actor()
    save_actor(tmp_path / "policy.safetensors", network, description["training"])
    for path in (tmp_path, tmp_path / "policy.safetensors"):
        loaded, told = load_actor(path)
        assert told["training"] == description["training"]
        for name, value in network.state_dict().items():
            torch.testing.assert_close(loaded.state_dict()[name], value, rtol=0, atol=0)
    assert {path.name for path in tmp_path.iterdir()} == {"policy.json", "policy.safetensors"}


def edit_json(path, change):
    value = json.loads(path.read_text())
    change(value)
    path.write_text(json.dumps(value))


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda p: p.with_suffix(".json").unlink(), "cannot be read"),
        (lambda p: p.unlink(), "no such expert checkpoint"),
        (lambda p: p.with_suffix(".json").write_text("{"), "not JSON"),
        (lambda p: p.write_bytes(b"\x80\x04pickle"), "not a safetensors file"),
        (lambda p: edit_json(p.with_suffix(".json"), lambda v: v.update(architecture_version=99)), "99"),
        (lambda p: edit_json(p.with_suffix(".json"), lambda v: v.update(architecture="act")), "'act'"),
        (lambda p: edit_json(p.with_suffix(".json"), lambda v: v.update(action_dim=7)), "action_dim is 7"),
        (lambda p: edit_json(p.with_suffix(".json"), lambda v: v["network"].update(lstm_size=32)), "do not fit"),
        (lambda p: edit_json(p.with_suffix(".json"), lambda v: v["network"].update(depth=3)), "unusable 'network'"),
    ],
)
def test_a_bad_checkpoint_is_named_and_explained(tmp_path, damage, said):
    network, _ = load_actor()
    path = tmp_path / "expert.safetensors"
    save_actor(path, network, {})
    damage(path)
    with pytest.raises(FileFormatError) as error:
        load_actor(path)
    assert said in str(error.value)
    assert "expert." in str(error.value)


def test_weights_that_are_not_finite_are_refused(tmp_path):
    network, _ = load_actor()
    with torch.no_grad():
        network.head[0].weight[0, 0] = float("nan")
    save_actor(tmp_path / "expert.safetensors", network, {})
    with pytest.raises(FileFormatError, match="not finite"):
        load_actor(tmp_path / "expert.safetensors")


@pytest.mark.parametrize("wrong", [{"lstm_size": -1}, {"hidden_sizes": ()}, {"thrust_scale_N": 0.0}])
def test_impossible_shapes_are_refused(wrong):
    with pytest.raises(InputError):
        NetworkConfig(**wrong)


def test_the_shipped_checkpoints_are_small():
    for shipped in (None, *NAMED):
        assert find_checkpoint(shipped).stat().st_size < 1_000_000
        assert training_counts("meta_rl", shipped)["interactions"] > 10_000_000


@pytest.mark.parametrize("checkpoint", [None, GENTLE])
@pytest.mark.parametrize("name", ["contact same", "contact random", "contact same_dispersed", "meta random"])
def test_the_shipped_experts_dock(name, checkpoint):
    flights = fly(MetaRlPolicy.load(checkpoint), TASKS[name], range(HELD_OUT_SEED, HELD_OUT_SEED + 100))
    assert flights.idss.mean() >= 0.97
    assert flights.miss_m.mean() < (0.05 if "meta" in name else 0.02)
    if checkpoint == GENTLE and "contact" in name:
        assert flights.smoothness.mean() < 1.35


@pytest.mark.parametrize("name", ["fixed same", "fixed random"])
def test_the_one_that_holds_is_at_the_port_at_the_last_step_whenever_it_came(name):
    flights = fly(MetaRlPolicy.load(HOLD), TASKS[name], range(HELD_OUT_SEED, HELD_OUT_SEED + 100))
    assert flights.miss_m.max() < 0.06
    assert abs(flights.closing_m_s).max() < 0.02
    assert flights.smoothness.mean() < 2.5


def test_the_shipped_expert_docks_at_the_other_port_as_well():
    task = TaskConfig(contact=True, hill_coupling=True, max_steps=100, port="harmony_forward")
    from lerobot_spacedock.physics.contact import HARMONY_FORWARD

    flights = fly(MetaRlPolicy.load(port=HARMONY_FORWARD), task, range(50))
    assert flights.idss.mean() >= 0.97
    # flown with the wrong port in mind it does not
    assert not fly(MetaRlPolicy.load(), task, range(5)).contact.any()
