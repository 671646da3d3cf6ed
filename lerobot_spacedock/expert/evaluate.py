"""Flies a policy over many episodes of the batched simulator, and prints what came of it.

``python -m lerobot_spacedock.expert.evaluate --policies meta_rl,W,mpc,zem`` gives the tables of ``docs/experts.md``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lerobot_spacedock import __version__
from lerobot_spacedock.env.batch import BatchedSpaceDock
from lerobot_spacedock.env.config import TaskConfig
from lerobot_spacedock.env.scenario_config import MetaRanges
from lerobot_spacedock.env.termination import CONTACT
from lerobot_spacedock.errors import InputError, SpaceDockError
from lerobot_spacedock.expert.policy import Policy
from lerobot_spacedock.files import write_json
from lerobot_spacedock.folders import check_output
from lerobot_spacedock.physics.frames import POSITION, VELOCITY

VALIDATION_SEED = 2_000_000
HELD_OUT_SEED = 3_000_000

_CONTACT = {"contact": True, "hill_coupling": True, "max_steps": 100}
# chasers and thrusters that no training has seen: about twice as far off as the training distribution
UNSEEN = MetaRanges(
    mass_fraction=0.35,
    inertia_fraction=0.35,
    inertia_product_kg_m2=14.0,
    thrust_scale=(0.75, 1.15),
    torque_scale=(0.75, 1.15),
    thrust_misalignment_deg=2.0,
    torque_bias_Nm=0.2,
    com_offset_m=0.04,
)
# every kind of episode that the expert is judged on
TASKS = {
    "fixed same": TaskConfig(),
    "fixed random": TaskConfig(initial_conditions="random"),
    "contact same": TaskConfig(**_CONTACT),
    "contact random": TaskConfig(**_CONTACT, initial_conditions="random"),
    "contact same_dispersed": TaskConfig(**_CONTACT, initial_conditions="same_dispersed"),
    "meta same": TaskConfig(**_CONTACT, dynamics="meta"),
    "meta random": TaskConfig(**_CONTACT, dynamics="meta", initial_conditions="random"),
    "meta same_dispersed": TaskConfig(**_CONTACT, dynamics="meta", initial_conditions="same_dispersed"),
    "unseen random": TaskConfig(**_CONTACT, dynamics="meta", initial_conditions="random", meta=UNSEEN),
}


@dataclass(frozen=True)
class Flights:
    """What came of N episodes, in the order of their seeds.

    Attributes:
        steps: (N,) steps flown.
        contact: (N,) the port was reached.
        idss: (N,) inside the IDSS box: at contact, or at the last state of the fixed horizon.
        miss_m: (N,) lateral miss where the port was reached, else the distance to it at the last state.
        speed_m_s: (N,) speed at the last state.
        closing_m_s: (N,) closing speed at the last state.
        lateral_speed_m_s: (N,)
        angle_deg: (N,) pitch and yaw together.
        roll_deg: (N,)
        rate_deg_s: (N,) all axes together.
        smoothness: (N,) Eq. 4: mean norm of the change of the raw command, N and N·m mixed.
        thrust_smoothness_N: (N,) the same of the thrust alone.
        torque_smoothness_Nm: (N,) the same of the torque alone.
    """

    steps: np.ndarray
    contact: np.ndarray
    idss: np.ndarray
    miss_m: np.ndarray
    speed_m_s: np.ndarray
    closing_m_s: np.ndarray
    lateral_speed_m_s: np.ndarray
    angle_deg: np.ndarray
    roll_deg: np.ndarray
    rate_deg_s: np.ndarray
    smoothness: np.ndarray
    thrust_smoothness_N: np.ndarray
    torque_smoothness_Nm: np.ndarray

    def summary(self) -> dict[str, float]:
        """Means and percentiles over all episodes, JSON-ready; nothing is dropped."""
        return {
            "episodes": len(self.steps),
            "idss_percent": 100.0 * self.idss.mean(),
            "contact_percent": 100.0 * self.contact.mean(),
            "miss_mean_m": self.miss_m.mean(),
            "miss_p95_m": np.percentile(self.miss_m, 95.0),
            "miss_p99_m": np.percentile(self.miss_m, 99.0),
            "closing_p5_m_s": np.percentile(self.closing_m_s, 5.0),
            "closing_p95_m_s": np.percentile(self.closing_m_s, 95.0),
            "lateral_speed_mean_m_s": self.lateral_speed_m_s.mean(),
            "angle_mean_deg": self.angle_deg.mean(),
            "rate_p95_deg_s": np.percentile(self.rate_deg_s, 95.0),
            "smoothness_mean": self.smoothness.mean(),
            "smoothness_std": self.smoothness.std(),
            "thrust_smoothness_mean_N": self.thrust_smoothness_N.mean(),
            "torque_smoothness_mean_Nm": self.torque_smoothness_Nm.mean(),
            "steps_mean": self.steps.mean(),
        }


def fly(policy: Policy, task: TaskConfig, seeds: Sequence[int]) -> Flights:
    """Flies one episode per seed, all at once.

    Args:
        policy: a batched policy; it is reset first.
        task: the task; episodes are what ``SpaceDockEnv.reset(seed=…)`` would give.
        seeds: of the episodes.
    """
    batch = BatchedSpaceDock(len(seeds), task)
    observation = batch.reset(np.asarray(seeds))
    policy.reset(batch.count)
    running = np.ones(batch.count, dtype=bool)
    change = np.zeros((3, batch.count))
    previous = None
    while running.any():
        action = np.where(running[:, None], policy.act(observation), 0.0)
        if previous is not None:
            delta = action - previous
            parts = [np.linalg.norm(delta[:, part], axis=1) for part in (slice(0, 6), slice(0, 3), slice(3, 6))]
            change += np.where(running, parts, 0.0)
        result = batch.step(action)
        running[result.ended] = False
        # what a policy makes of a row that has ended does not matter, but its input has to be finite
        observation, previous = result.observation, action
    state = batch.sim.state
    distance = np.linalg.norm(state[:, POSITION], axis=1)
    contact = batch.sim.code == CONTACT
    report = batch.report(state, at_plane=contact)
    if task.contact:
        # no contact, no lateral miss at the port: what counts is how far away the chaser ended
        miss = np.where(contact, report["lateral_m"], distance)
    else:
        miss = distance
    smoothness = change / np.maximum(batch.sim.step - 1, 1)
    return Flights(
        steps=batch.sim.step.copy(),
        contact=contact,
        idss=report["idss"] & (contact if task.contact else True),
        miss_m=miss,
        speed_m_s=np.linalg.norm(state[:, VELOCITY], axis=1),
        closing_m_s=report["closing_speed_m_s"],
        lateral_speed_m_s=report["lateral_speed_m_s"],
        angle_deg=report["pitch_yaw_deg"],
        roll_deg=report["roll_deg"],
        rate_deg_s=np.hypot(report["pitch_yaw_rate_deg_s"], report["roll_rate_deg_s"]),
        smoothness=smoothness[0],
        thrust_smoothness_N=smoothness[1],
        torque_smoothness_Nm=smoothness[2],
    )


def table(rows: list[tuple[str, str, dict[str, float]]]) -> str:
    """Markdown of (policy, task, summary) rows."""
    head = (
        "| policy | task | IDSS % | contact % | miss mean / p95 / p99, cm | closing p5–p95, m/s | lateral m/s "
        "| angle ° | rate p95 °/s | smoothness | steps |\n|---|---|---|---|---|---|---|---|---|---|---|"
    )
    lines = [head]
    for policy, task, s in rows:
        lines.append(
            f"| {policy} | {task} | {s['idss_percent']:.1f} | {s['contact_percent']:.1f} "
            f"| {100 * s['miss_mean_m']:.1f} / {100 * s['miss_p95_m']:.1f} / {100 * s['miss_p99_m']:.1f} "
            f"| {s['closing_p5_m_s']:.3f}–{s['closing_p95_m_s']:.3f} | {s['lateral_speed_mean_m_s']:.4f} "
            f"| {s['angle_mean_deg']:.2f} | {s['rate_p95_deg_s']:.3f} "
            f"| {s['smoothness_mean']:.2f} ± {s['smoothness_std']:.2f} | {s['steps_mean']:.1f} |"
        )
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """The command line."""
    from lerobot_spacedock.expert.controllers import EXPERTS, META_RL, check_expert, make_expert

    parser = argparse.ArgumentParser(prog="python -m lerobot_spacedock.expert.evaluate", description=__doc__)
    parser.add_argument("--policies", default="meta_rl", help=f"comma-separated: {', '.join(EXPERTS)}, MODULE:FACTORY")
    parser.add_argument("--tasks", default=",".join(TASKS), help=f"comma-separated: {', '.join(TASKS)}; default: all")
    parser.add_argument("--episodes", type=int, default=1000, help="of each task; default: 1000")
    parser.add_argument("--seed", type=int, default=HELD_OUT_SEED, help="of the first episode")
    parser.add_argument("--checkpoint", help="of meta_rl: file, folder, gentle, hold; default: the shipped one")
    parser.add_argument("--json", type=Path, help="write the summaries here too")
    arguments = parser.parse_args(argv)
    try:
        if arguments.episodes < 1:
            raise InputError("--episodes", arguments.episodes, "1 or more")
        if arguments.json:
            check_output(arguments.json, "--json")
        names = arguments.policies.split(",")
        for name in names:
            check_expert(name, "--policies")
        if arguments.checkpoint and not set(META_RL) & set(names):
            raise InputError("--checkpoint", arguments.checkpoint, "nothing, unless --policies names a meta_rl")
        tasks = arguments.tasks.split(",")
        for task in tasks:
            if task not in TASKS:
                raise InputError("--tasks", task, ", ".join(TASKS))
        # all of them before the first flies
        policies = [
            (name, task, make_expert(name, TASKS[task], checkpoint=arguments.checkpoint))
            for name in names
            for task in tasks
        ]
        seeds = range(arguments.seed, arguments.seed + arguments.episodes)
        rows = [(name, task, fly(policy, TASKS[task], seeds).summary()) for name, task, policy in policies]
    except SpaceDockError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    print(table(rows))
    if arguments.json:
        checkpoint = dict.fromkeys(META_RL, arguments.checkpoint)
        records = [
            {"policy": name, "checkpoint": checkpoint.get(name), "task": task, "seed": arguments.seed}
            | {"spacedock": __version__, **summary}
            for name, task, summary in rows
        ]
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        write_json(arguments.json, records, indent=2, default=float)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
