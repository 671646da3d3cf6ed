"""One trial: demonstrations, a student, and its episodes on every task under every coefficient."""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path
from typing import Any

from lerobot_spacedock.metrics.statistics import clopper_pearson, summarize
from lerobot_spacedock.study.config import SweepConfig
from lerobot_spacedock.study.demonstrations import demonstrations, demos_config
from lerobot_spacedock.study.rollout import Pilot, env_config, evaluate
from lerobot_spacedock.study.students import StudentConfig, train

_OPTIONS = {field.name for field in dataclasses.fields(StudentConfig)}


def run_trial(point: dict[str, Any], config: SweepConfig) -> dict[str, Any]:
    """Runs one combination of the axes.

    Args:
        point: a value for each of ``config.axes()``.
        config: how it is judged.

    Returns:
        JSON-ready: the point, the demonstrations, the loss, processor time, and a row for each task and coefficient.
    """
    began = time.process_time()
    chosen = demos_config(point["demonstrations"], point["num_demonstrations"], point["seed"])
    frames = demonstrations(chosen, Path(config.output_dir) / "demonstrations")
    trained_from = time.process_time()
    student = train(StudentConfig(**{name: value for name, value in point.items() if name in _OPTIONS}), frames)
    judged_from = time.process_time()
    rows = []
    for task in config.tasks:
        env = env_config(*task.split("/"))
        seeds = range(config.evaluation_seed, config.evaluation_seed + config.episodes)
        for coefficient in config.weightings:
            episodes = evaluate(Pilot(student, coefficient), env, seeds)
            rows.append({"task": task, "coefficient": coefficient} | summary(episodes))
    return {
        "point": point,
        "demonstrations": {"episodes": len(frames.starts), "frames": len(frames.state), "docked": frames.docked},
        "loss": round(student.final_loss, 5),
        "cpu_s": {
            "demonstrations": round(trained_from - began, 1),
            "training": round(judged_from - trained_from, 1),
            "evaluation": round(time.process_time() - judged_from, 1),
        },
        "rows": rows,
    }


def summary(episodes: list[dict[str, Any]]) -> dict[str, Any]:
    """What a table and a figure need of all episodes of one task; nothing is dropped. Metres, m/s, N and N·m mixed.

    An episode of one command has no smoothness; it counts in the rest.
    """

    def of(name: str, *statistics: str) -> dict[str, float | None]:
        found = summarize([float(episode[name]) for episode in episodes if _defined(episode[name])], name)
        return {statistic: _short(getattr(found, statistic)) for statistic in statistics}

    idss = clopper_pearson(sum(bool(episode["idss"]) for episode in episodes), len(episodes))
    return {
        "episodes": len(episodes),
        "idss": sum(bool(episode["idss"]) for episode in episodes),
        "idss_interval": [_short(idss.low), _short(idss.high)],
        "contact": sum(bool(episode["crossed"]) for episode in episodes),
        "distance_m": of("final_distance_m", "mean", "median", "p75", "p95", "p99", "min"),
        "speed_m_s": of("final_speed_m_s", "mean", "p75", "p95", "p99"),
        "closing_m_s": of("final_closing_m_s", "min", "median", "max"),
        "smoothness": of("smoothness", "mean", "std"),
        "steps": of("steps", "mean"),
    }


def _defined(value: float | None) -> bool:
    return value is not None and not math.isnan(value)


def _short(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.4g}")
