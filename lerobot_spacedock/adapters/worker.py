"""What the processes of ``--eval.use_async_envs=true`` share: imported once, by the server they are forked from."""

import gc

import lerobot.envs.utils  # noqa: F401

import lerobot_spacedock.camera.software
import lerobot_spacedock.env.spacedock  # noqa: F401

# the collector would touch, and so copy, every page of what was imported in each process
gc.collect()
gc.freeze()
