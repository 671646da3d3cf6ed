"""The environment as a hub repository: ``env.py`` with the ``make_env`` that LeRobot calls, and its card."""

from __future__ import annotations

from pathlib import Path

from lerobot_spacedock import __version__

ENV_SOURCE = '''"""SpaceDock for LeRobot's EnvHub: needs `pip install lerobot_env_spacedock`."""

import dataclasses

from lerobot.envs.configs import EnvConfig

from lerobot_spacedock.adapters.env_config import SpaceDockEnvConfig

LEROBOTS = {field.name for field in dataclasses.fields(EnvConfig)} - {"task"}  # what every env of LeRobot's has


def make_env(n_envs=1, use_async_envs=False, cfg=None):
    """{suite: {task_id: VectorEnv}}, as LeRobot's own environments.

    `cfg`: a SpaceDockEnvConfig; or LeRobot's HubEnvConfig, of whose options every one that SpaceDock has too counts.
    """
    if not isinstance(cfg, SpaceDockEnvConfig):
        names = {field.name for field in dataclasses.fields(SpaceDockEnvConfig) if field.init} - LEROBOTS
        given = {name: value for name, value in vars(cfg).items() if name in names} if cfg is not None else {}
        cfg = SpaceDockEnvConfig(**{name: value for name, value in given.items() if value is not None})
    return cfg.create_envs(n_envs=n_envs, use_async_envs=use_async_envs)
'''


def write_env_hub(folder: Path, repo_id: str, *, license_id: str, tags: tuple[str, ...] = ()) -> None:
    """Writes ``env.py``, ``requirements.txt`` and ``README.md`` into ``folder``."""
    import yaml

    header = {"license": license_id, "library_name": "lerobot", "tags": ["lerobot", "environment", "spacecraft", *tags]}
    (folder / "env.py").write_text(ENV_SOURCE)
    (folder / "requirements.txt").write_text(f"lerobot_env_spacedock>={__version__}\n")
    (folder / "README.md").write_text(
        f"---\n{yaml.safe_dump(header, sort_keys=False).strip()}\n---\n\n"
        f"# {repo_id.partition('/')[2]}\n\n"
        "Docking with the International Space Station: a gymnasium environment for LeRobot.\n\n"
        "```python\nfrom lerobot.envs.factory import make_env\n\n"
        f'envs = make_env("{repo_id}", n_envs=2, trust_remote_code=True)\n```\n'
    )
