"""Vector environments that carry the terminal ``info`` out of LeRobot's evaluation, which keeps reward and success.

Subclasses of gymnasium's own, since LeRobot tells Sync from Async by class. Both run with ``NEXT_STEP`` and frozen
sub-environments (``FreezeAfterEpisodeEnd``), so that a finished episode costs nothing and adds no reward while the
others of its batch fly on.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import time
from collections.abc import Iterator
from multiprocessing.connection import wait
from typing import Any

import numpy as np
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv
from gymnasium.vector.async_vector_env import AsyncState
from lerobot.utils.constants import OBS_STATE

from lerobot_spacedock.adapters.evaluation_log import EvaluationLog, Inference
from lerobot_spacedock.errors import SpaceDockError


class _Logging:
    """Notices each episode's end once, and hands it to the evaluation log.

    Between an answer of this env and the next ``step`` it is the policy's turn, with its processors, for the whole
    batch: that time is logged as ``inference_s``. Every ``call`` counts as an answer, so LeRobot's renders, which come
    before it asks for the task and infers, are not in it.
    """

    def __init__(self, env_fns, *, log: EvaluationLog | None = None, **options: Any) -> None:
        self._log = log
        self._cold = True  # the first inference of all also compiles and allocates
        super().__init__(env_fns, autoreset_mode=AutoresetMode.NEXT_STEP, **options)

    def reset(self, *, seed=None, options=None):
        observation, info = super().reset(seed=seed, options=options)
        seeds = [seed + i for i in range(self.num_envs)] if isinstance(seed, int) else seed
        self._finished = np.zeros(self.num_envs, dtype=bool)
        self._returns = np.zeros(self.num_envs)
        self._steps = 0
        self._inference = Inference(batch=self.num_envs, warm_up_steps=int(self._cold))
        if self._log is not None:
            self._log.start_batch(list(seeds) if seeds is not None else [None] * self.num_envs)
        self._answered_s = time.perf_counter()
        return _with_dataset_names(observation), info

    def call(self, name, *args, **kwargs):
        results = super().call(name, *args, **kwargs)
        self._answered_s = time.perf_counter()
        return results

    def step(self, actions):
        self._inference.step_s.append(time.perf_counter() - self._answered_s)
        self._cold = False
        observation, reward, terminated, truncated, info = super().step(actions)
        self._steps += 1
        self._returns += np.where(self._finished, 0.0, reward)
        ended = (terminated | truncated) & ~self._finished
        self._finished |= ended
        if self._log is not None:
            for index in np.flatnonzero(ended):
                counts = {"steps": self._steps, "return": float(self._returns[index])}
                self._log.finish(int(index), counts | _of_env(info, index), self._inference)
        self._answered_s = time.perf_counter()
        return _with_dataset_names(observation), reward, terminated, truncated, info

    def close(self, **options):
        super().close(**options)
        if self._log is not None:
            self._log.close()


class LoggingSyncVectorEnv(_Logging, SyncVectorEnv):
    """One process, one episode after the other within a step."""


class LoggingAsyncVectorEnv(_Logging, AsyncVectorEnv):
    """One process an environment, forked from a server that has imported LeRobot once for all of them."""

    def __init__(self, env_fns, *, log: EvaluationLog | None = None, **options: Any) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["lerobot_spacedock.adapters.worker"])
        super().__init__(env_fns, log=log, context="forkserver", **options)

    def reset(self, **options):
        with self._naming_a_lost_process():
            return super().reset(**options)

    def call(self, name, *args, **kwargs):
        with self._naming_a_lost_process():
            return super().call(name, *args, **kwargs)

    def step(self, actions):
        with self._naming_a_lost_process():
            return super().step(actions)

    @contextlib.contextmanager
    def _naming_a_lost_process(self) -> Iterator[None]:
        """Ends the others and says what happened; gymnasium would wait for ever for the lost one's answer, at exit too.

        Raises:
            SpaceDockError: an environment's process was killed.
        """
        try:
            yield
        except (EOFError, ConnectionError) as error:
            wait([process.sentinel for process in self.processes], timeout=1.0)  # its pipe is gone before it is
            lost = [index for index, process in enumerate(self.processes) if not process.is_alive()]
            self._state = AsyncState.DEFAULT
            self.close(terminate=True)
            kept = "" if self._log is None else f" Finished episodes are kept in {self._log.folder}."
            raise SpaceDockError(
                f"The process of environment {lost} was ended from outside (killed, or out of memory).{kept} Evaluate "
                "again into another --env.log_dir, with a smaller --eval.batch_size if memory was short."
            ) from error


def _of_env(info: dict[str, Any], index: int) -> dict[str, Any]:
    """What one sub-environment put into the batched ``info``."""
    found = {}
    for key, values in info.items():
        mask = info.get(f"_{key}")
        if mask is not None and mask[index] and not isinstance(values, dict):
            found[key] = values[index]
    return found


def _with_dataset_names(observation: dict[str, Any]) -> dict[str, Any]:
    """Adds the state under its dataset name, where ``--eval.recording=true`` looks for it."""
    if "agent_pos" in observation:
        return {**observation, OBS_STATE: observation["agent_pos"]}
    return observation
