"""Measurements of the expert that stand in docs/experts.md.

python benchmarks/expert.py curves outputs/expert/meta_rl outputs/expert/feed_forward
python benchmarks/expert.py adaptation --checkpoint outputs/expert/feed_forward/policy.safetensors
python benchmarks/expert.py seeds outputs/expert/seed_0.json outputs/expert/seed_1.json outputs/expert/seed_2.json
python benchmarks/expert.py speed
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from lerobot_spacedock.env.batch import BatchedSpaceDock
from lerobot_spacedock.env.reward import speed_profile
from lerobot_spacedock.env.reward_config import RewardConfig
from lerobot_spacedock.env.termination import RUNNING
from lerobot_spacedock.expert.controllers import make_expert
from lerobot_spacedock.expert.evaluate import HELD_OUT_SEED, TASKS
from lerobot_spacedock.expert.meta_rl import MetaRlPolicy

PANELS = (
    ("idss_percent", "IDSS box, %", 1.0, (0.0, 101.0)),
    ("miss_mean_m", "mean miss, cm", 100.0, (0.0, 20.0)),
    ("smoothness_mean", "smoothness (Eq. 4)", 1.0, (0.0, 5.0)),
)
CURVE_TASKS = ("contact same", "meta random")


def curves(folders: list[Path], png: Path) -> None:
    """Learning curves of trainings, deterministic on validation episodes, over interactions."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(CURVE_TASKS), len(PANELS), figsize=(12.0, 6.0), sharex=True, squeeze=False)
    for folder in folders:
        training = json.loads((folder / "training.json").read_text())
        curve = training["curve"]
        x = [point["interactions"] / 1e6 for point in curve]
        cost = f" ({training['cpu_s'] / 60:.0f} CPU min)" if "cpu_s" in training else ""
        label = folder.name + cost
        for row, task in enumerate(CURVE_TASKS):
            for column, (key, _, factor, _) in enumerate(PANELS):
                axes[row, column].plot(x, [factor * point[task][key] for point in curve], label=label)
    for row, task in enumerate(CURVE_TASKS):
        for column, (_, name, _, limits) in enumerate(PANELS):
            axes[row, column].set(title=f"{task}: {name}", ylim=limits)
            axes[row, column].grid(alpha=0.3)
    for axis in axes[-1]:
        axis.set_xlabel("interactions, millions")
    axes[0, 0].legend(fontsize=8)
    figure.tight_layout()
    png.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(png, dpi=110)
    print(f"wrote {png}")


def adaptation(checkpoints: list[Path], episodes: int, every: int) -> None:
    """Errors over the episode on chasers that no training has seen: what a memory is for."""
    task = TASKS["unseen random"]
    policies = {"recurrent": make_expert("meta_rl", task), "memory cleared": make_expert("meta_rl_forgetful", task)}
    policies |= {path.parent.name: MetaRlPolicy.load(path) for path in checkpoints}
    distance, speed = speed_profile(RewardConfig()).table()
    steps = list(range(0, 64, every))
    print("median over the episodes still flying: angle to the docking attitude (°) / off the speed profile (mm/s)\n")
    print("| policy | " + " | ".join(f"step {step}" for step in steps) + " |")
    print("|---|" + "---|" * len(steps))
    for name, policy in policies.items():
        batch = BatchedSpaceDock(episodes, task)
        observation = batch.reset(np.arange(HELD_OUT_SEED, HELD_OUT_SEED + episodes))
        policy.reset(episodes)
        cells = []
        for step in range(steps[-1] + 1):
            if step in steps:
                state = batch.sim.state[batch.sim.code == RUNNING]
                report = batch.report(state)
                angle = np.hypot(report["pitch_yaw_deg"], report["roll_deg"])
                lag = np.abs(report["closing_speed_m_s"] - np.interp(report["axial_m"], distance, speed))
                cells.append(f"{np.median(angle):.2f} / {1000 * np.median(lag):.0f}" if len(state) else "–")
            observation = batch.step(policy.act(observation)).observation
        print(f"| {name} | " + " | ".join(cells) + " |")


def speed(counts: list[int], steps: int) -> None:
    """Commands a second of each expert, one process."""
    print("| expert | " + " | ".join(f"{count} at once" for count in counts) + " |")
    print("|---|" + "---|" * len(counts))
    for name in ("meta_rl", "W", "mpc", "mpc_fixed", "zem"):
        cells = []
        for count in counts:
            policy, batch = make_expert(name, TASKS["contact same"]), BatchedSpaceDock(count, TASKS["contact same"])
            observation = batch.reset(np.arange(count))
            policy.reset(count)
            policy.act(observation)
            start = time.perf_counter()
            for _ in range(steps):
                policy.act(observation)
            cells.append(f"{count * steps / (time.perf_counter() - start):,.0f}/s")
        print(f"| {name} | " + " | ".join(cells) + " |")


def seeds(files: list[Path]) -> None:
    """Each task's results over several training seeds, from what ``expert.evaluate --json`` wrote: value by value."""
    runs = [{(row["policy"], row["task"]): row for row in json.loads(file.read_text())} for file in files]
    columns = (
        ("IDSS %", "idss_percent", 1.0, ".1f"),
        ("miss mean, cm", "miss_mean_m", 100.0, ".1f"),
        ("miss p99, cm", "miss_p99_m", 100.0, ".1f"),
        ("smoothness", "smoothness_mean", 1.0, ".2f"),
    )
    print("| policy | task | " + " | ".join(name for name, *_ in columns) + " |")
    print("|---" * (len(columns) + 2) + "|")
    for key in runs[0]:
        cells = [" / ".join(format(scale * run[key][name], spec) for run in runs) for _, name, scale, spec in columns]
        print(f"| {key[0]} | {key[1]} | " + " | ".join(cells) + " |")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    verb = verbs.add_parser("curves", help=curves.__doc__)
    verb.add_argument("folders", nargs="+", type=Path)
    verb.add_argument("--png", type=Path, default=Path("docs/images/expert_learning.png"))
    verb = verbs.add_parser("adaptation", help=adaptation.__doc__)
    verb.add_argument("--checkpoint", nargs="*", type=Path, default=[], help="others to set beside the shipped one")
    verb.add_argument("--episodes", type=int, default=1000)
    verb.add_argument("--every", type=int, default=9)
    verb = verbs.add_parser("seeds", help=seeds.__doc__)
    verb.add_argument("files", nargs="+", type=Path, help="one a training seed")
    verb = verbs.add_parser("speed", help=speed.__doc__)
    verb.add_argument("--counts", nargs="+", type=int, default=[1, 64, 1024])
    verb.add_argument("--steps", type=int, default=50)
    arguments = parser.parse_args()
    if arguments.verb == "curves":
        curves(arguments.folders, arguments.png)
    elif arguments.verb == "adaptation":
        adaptation(arguments.checkpoint, arguments.episodes, arguments.every)
    elif arguments.verb == "seeds":
        seeds(arguments.files)
    else:
        speed(arguments.counts, arguments.steps)


if __name__ == "__main__":
    main()
