"""Minari datasets recorded from these environments (or of the same layout).

Observations are the environment's own: ``agent_pos``, and ``pixels`` → ``camera`` where the recording kept them; or one
array of states. Times and true states are taken from the infos that the environment gives (``time_s``, ``state``),
where the recording kept those; what the policy saw of imperfect sensors then stands beside the truth. The chaser that
was drawn is the recording's ``dynamics`` among the infos; seed and environment are what Minari keeps itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.dataset.episode import reading_columns
from lerobot_spacedock.dataset.source_env import readable
from lerobot_spacedock.dataset.sources import NO_CHASER, EpisodeRef, LoadedEpisode
from lerobot_spacedock.dataset.sources.arrays import log_of_arrays
from lerobot_spacedock.env.registration import ENV_IDS
from lerobot_spacedock.errors import FileFormatError, InputError, MissingDependencyError, reading


def list_episodes(path: Path, options: tuple) -> list[EpisodeRef]:
    dataset = _open(str(path))
    return [EpisodeRef("minari", str(path), str(index), options) for index in dataset.episode_indices]


def load(ref: EpisodeRef) -> LoadedEpisode:
    dataset = _open(ref.path)
    episode = next(iter(dataset.iterate_episodes([int(ref.key)])))
    observations, infos = episode.observations, episode.infos or {}
    states = observations.get("agent_pos") if isinstance(observations, dict) else observations
    if not isinstance(states, np.ndarray):
        raise FileFormatError(f"{ref.name}: no 'agent_pos' among the observations.")
    true = np.asarray(infos["state"]) if "state" in infos else states
    success = infos.get("is_success")
    log = log_of_arrays(
        ref.name,
        state=true,
        action=np.asarray(episode.actions),
        time=infos.get("time_s"),
        reward=np.asarray(episode.rewards),
        step_s=float(ref.option("step_s") or 0.907),
        metadata={
            "source": "minari",
            "success": None if success is None else bool(np.asarray(success)[-1]),
        }
        | _flown_in(ref, dataset, infos),
    )
    if true is not states:
        with reading(ref.name, "an episode"):
            log = replace(log, extra=reading_columns(states[: log.num_steps], log.state[:-1]))
    pictures = _pictures(ref, observations)
    if pictures is None:
        return LoadedEpisode(log)

    def frames(first: int) -> Iterator[np.ndarray]:
        return iter(pictures[first : log.num_steps])

    return LoadedEpisode(log, frames)


def _flown_in(ref: EpisodeRef, dataset: Any, infos: dict[str, Any]) -> dict[str, Any]:
    """What a log says of its flight: seed, environment and the chaser that was drawn, where the recording has them."""
    with reading(ref.name, "an episode"):
        kept = next(iter(dataset.storage.get_episode_metadata([int(ref.key)])))
        found: dict[str, Any] = {"seed": kept.get("seed")}
        made = {**dataset.env_spec.kwargs, "log_dir": None} if dataset.env_spec is not None else None
        if made is not None:
            made.pop("render_mode", None)
        env = readable(made) if made is not None and made.get("env_id") in ENV_IDS else None
        if env is not None:
            given = "state" in (kept.get("options") or {})
            starts = "given" if given else env.initial_conditions
            found |= {"env_id": env.env_id, "config": asdict(env), "initial_conditions": starts}
        if "dynamics" in infos:
            found["dynamics"] = {name: np.asarray(values)[0].tolist() for name, values in infos["dynamics"].items()}
        elif env is not None and env.dynamics == "meta":
            found["chaser"] = NO_CHASER
        return found


def _pictures(ref: EpisodeRef, observations: Any) -> np.ndarray | None:
    if not isinstance(observations, dict) or "pixels" not in observations:
        return None
    pixels = observations["pixels"]
    if not isinstance(pixels, dict):
        return pixels
    if "camera" not in pixels:
        raise FileFormatError(f"{ref.name}: cameras {sorted(pixels)}; one of them has to be called 'camera'.")
    return pixels["camera"]


def _open(path: str) -> Any:
    try:
        import minari
    except ImportError as error:
        raise MissingDependencyError("minari is needed: pip install '.[minari]' in SpaceDock's folder") from error
    try:
        if Path(path).is_dir():
            data = Path(path) / "data"
            return minari.MinariDataset(data if data.is_dir() else Path(path))
        return minari.load_dataset(path)
    except (FileNotFoundError, ValueError, OSError, KeyError) as error:
        raise InputError(
            "--source", path, "a Minari dataset: its folder, or the id of a local one", str(error)
        ) from error
