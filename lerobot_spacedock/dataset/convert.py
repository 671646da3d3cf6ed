"""``spacedock convert``: rollouts that exist already become a LeRobotDataset of the one schema."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from lerobot_spacedock.camera import CameraConfig
from lerobot_spacedock.camera.config import PORTS
from lerobot_spacedock.dataset.assemble import assemble
from lerobot_spacedock.dataset.camera_flags import CameraFlags, over
from lerobot_spacedock.dataset.encoder import check_encoder
from lerobot_spacedock.dataset.episode import succeeded
from lerobot_spacedock.dataset.frames import check_drawing, drawing_options
from lerobot_spacedock.dataset.job import Job, Plan, dotted, shard_count
from lerobot_spacedock.dataset.record import DatasetLayout, Storage
from lerobot_spacedock.dataset.roots import check_repo_id, dataset_root
from lerobot_spacedock.dataset.scale import ExecutorConfig, run_executor
from lerobot_spacedock.dataset.segments import Segment
from lerobot_spacedock.dataset.selection import RULES, best, check_rule, score
from lerobot_spacedock.dataset.shards import reason_of
from lerobot_spacedock.dataset.source_env import first_episode, pictured_env, stated_env
from lerobot_spacedock.dataset.sources import FORMATS, EpisodeRef, list_episodes, load
from lerobot_spacedock.dataset.workers import check_workers
from lerobot_spacedock.env.config import SpaceDockConfig
from lerobot_spacedock.errors import FileFormatError, InputError, one_of
from lerobot_spacedock.invocation import available_cores, command_line
from lerobot_spacedock.metrics.episode import port_of


@dataclass
class ConvertConfig:
    """Turn rollouts that exist already into a LeRobotDataset."""

    # folder that holds the rollouts (minari: or the id of a local dataset)
    source: str
    # user/name of the dataset
    repo_id: str
    # logs | raw | hdf5 | npz | minari | lerobot | v21
    format: str = "logs"
    # folder of the dataset; by default LeRobot's own place for this repo_id. Must not exist
    root: str | None = None
    # keep the best so many by --select; 0 keeps all
    num_episodes: int = 0
    # first | distance | propellant | smoothness | return: what the best are best at
    select: str = "first"
    # successful dockings rank before all others
    successes_first: bool = False
    # leave out episodes that cannot be read, and list them, instead of stopping at the first
    skip_bad: bool = False
    # all | last:10m | last:20s | last:30: which part of each episode
    segment: str = "all"
    # write each whole episode once and its segment so many times more
    repeat_terminal: int = 0
    # the observed state carries the mass (14 values); left out, as the logs' environment or the dataset has it
    with_mass: bool | None = None
    # the observed state holds velocity and rates only (6 values), as in SpaceDockVision-v0; left out, the same
    withhold_pose: bool | None = None
    # auto takes stored pictures and draws where there are none; draw always draws; none writes states alone
    images: str = "auto"
    # zvezda_aft | harmony_forward: the port of flights that name none; left out, zvezda_aft
    port: str | None = None
    camera: CameraFlags = field(default_factory=CameraFlags)
    # software | pyrender: the renderer where pictures are drawn; left out, as the flights state, or software
    renderer: str | None = None
    # fixed | random | orbit | eclipse: the Sun where pictures are drawn; left out, as the flights state, or fixed
    sun: str | None = None
    storage: Storage = field(default_factory=Storage)
    # what the dataset says the task is; left out, what the source says, or "dock with the International Space Station"
    task: str | None = None
    # s, length of a step where the source has no times (hdf5, npz, minari, lerobot)
    step_s: float = 0.907
    # processes (or tasks at a time) that draw and encode; 0 takes one a core
    num_workers: int = 0
    # where episodes are drawn and encoded: this machine's processes, or tasks of a pipeline
    executor: ExecutorConfig = field(default_factory=ExecutorConfig)

    def settings(self) -> dict[str, Any]:
        values = asdict(self)
        for name in ("root", "num_workers", "executor"):
            values.pop(name)
        return values

    @property
    def asked_port(self) -> str | None:
        """That of the flights or, as everywhere, that of the camera where it is not the usual one."""
        return self.port or (None if self.camera.port == CameraConfig.port else self.camera.port)


def convert(config: ConvertConfig) -> int:
    """Runs the verb; see the module.

    Raises:
        InputError: an option that cannot be used, or a source in which there is nothing.
        FileFormatError: an episode that cannot be read, naming file and place; nothing is written then.
    """
    _check(config)
    root = dataset_root(config.repo_id, config.root)
    if config.format == "v21":
        from lerobot_spacedock.dataset.sources.v21 import convert_v21

        return convert_v21(config, root)
    check_encoder(_layout(config, over(config.camera, CameraConfig())))
    job = Job(root)
    with job.disk_errors(), job.lock():
        if job.begin(config.settings()):
            print(f"Going on with the unfinished job in {job.folder}")
        if not job.plan_path.exists():
            job.write_plan(*_plan(config))
        run_executor(job, config.executor, num_workers=config.num_workers, total_frames=None)
        chosen = Plan.read(job.plan_path).facts["selection"]
        total = assemble(job)
    print(f"Wrote {total.episodes} episodes, {total.frames} frames to {root}")
    if chosen["kept"] < chosen["of"]:
        print(f"  chosen: {chosen['kept']} of {chosen['of']} ({chosen['rule_text']})")
    for note in total.notes:
        print(f"  {note}")
    if total.left_out:
        print(f"Left out {len(total.left_out)}:")
        for name, reason in total.left_out:
            print(f"  {name}: {reason}")
    print(f"Next: spacedock check --repo_id={config.repo_id} --root={root}")
    return 0


def _check(config: ConvertConfig) -> None:
    check_repo_id(config.repo_id)
    check_rule(config.select)
    check_workers(config.num_workers)
    if config.format not in FORMATS:
        raise InputError("--format", config.format, "; ".join(f"{name}: {text}" for name, text in FORMATS.items()))
    if config.images not in ("auto", "draw", "none"):
        raise InputError("--images", config.images, "auto | draw | none")
    if config.num_episodes < 0:
        raise InputError("--num_episodes", config.num_episodes, "0 for all, or more")
    if not config.num_episodes and (config.select != "first" or config.successes_first):
        given = f"--select={config.select} --successes_first={str(config.successes_first).lower()} without a number"
        raise InputError("--num_episodes", given, "how many to keep", "Left out, all are kept.")
    if not (math.isfinite(config.step_s) and config.step_s > 0.0):
        raise InputError("--step_s", config.step_s, "seconds, above 0")
    if config.repeat_terminal < 0 or (config.repeat_terminal and Segment.parse(config.segment).whole):
        raise InputError("--repeat_terminal", config.repeat_terminal, "0, or more with a --segment such as last:10m")
    Segment.parse(config.segment)
    if config.port is not None:
        one_of("--port", config.port, PORTS)
    if config.port is not None and config.camera.port not in (None, CameraConfig.port, config.port):
        raise InputError("--camera.port", config.camera.port, f"{config.port}, the --port", "Give --port alone.")
    _layout(config, over(config.camera, CameraConfig())).columns()


def _layout(config: ConvertConfig, camera: CameraConfig) -> DatasetLayout:
    return DatasetLayout(
        repo_id=config.repo_id,
        height=camera.height,
        width=camera.width,
        with_mass=bool(config.with_mass),
        withhold_pose=bool(config.withhold_pose),
        image=config.images != "none",
        task=config.task,
        storage=config.storage,
    )


def _plan(config: ConvertConfig) -> tuple[Plan, list[EpisodeRef]]:
    options = {"step_s": config.step_s} if config.format in ("hdf5", "npz", "minari", "lerobot") else {}
    source = config.source if config.format == "minari" else Path(config.source).resolve()
    found = list_episodes(config.format, source, port=config.asked_port, **options)
    refs, selection, left_out = _select(config, found)
    log, picture = first_episode(refs, pictures=config.images == "auto")
    drawn = config.images == "draw" or (config.images == "auto" and picture is None)
    inherited = _inherited(config)
    env = stated_env(log, inherited)
    seen = _seen(config, env)
    config = replace(config, **{name: value for name, value in seen.items() if getattr(config, name) is None})
    port = port_of(log.metadata).name if log is not None else config.asked_port or CameraConfig.port
    shown = _shown(config, env or pictured_env(inherited, port), None if drawn else picture)
    layout = _layout(config, shown.camera)
    layout.columns()
    drawing = drawing_options(shown) if config.images != "none" else None
    if drawn and drawing is not None and config.executor.here:
        check_drawing(drawing)
    plan = Plan(
        layout=layout,
        num_shards=shard_count(len(refs), config.num_workers or available_cores()),
        drawing=drawing,
        redraw=config.images == "draw",
        segment=config.segment,
        repeat_terminal=config.repeat_terminal,
        skip_bad=config.skip_bad,
        as_stated=_left_to_flights(config) if drawn and config.format == "logs" else [],
        facts=inherited
        | {
            "made_by": "spacedock convert",
            "command": command_line(),
            "source": {"format": config.format, "description": FORMATS[config.format], "episodes": len(found)},
            **({"port": port} if env is None else {"env": asdict(shown)}),
            "selection": selection,
            "segment": config.segment,
            "repeat_terminal": config.repeat_terminal,
            "storage": asdict(config.storage),
            "drawing": drawing,
            "pictures": "stored" if config.images == "auto" and not drawn else "drawn",
            **({"left_out": left_out} if left_out else {}),
        },
    )
    return plan, refs


def _shown(config: ConvertConfig, env: SpaceDockConfig, stored: np.ndarray | None) -> SpaceDockConfig:
    """``env`` with the camera, renderer and Sun that were asked for; else of the size of the stored picture, if any."""
    base = env.camera
    if stored is not None:
        base = replace(base, height=stored.shape[0], width=stored.shape[1])
    camera = replace(over(config.camera, base), port=env.port)
    return replace(env, camera=camera, renderer=config.renderer or env.renderer, sun=config.sun or env.sun)


def _left_to_flights(config: ConvertConfig) -> list[str]:
    """The options of the pictures that no flag gives: what each flight states, size apart."""
    asked = {"camera": asdict(config.camera), "renderer": config.renderer, "sun": config.sun}
    left = [name for name, value in dotted(asked).items() if value is None]
    return [name for name in left if name not in ("camera.height", "camera.width", "camera.port")]


def _inherited(config: ConvertConfig) -> dict[str, Any]:
    if config.format != "lerobot":
        return {}
    from lerobot_spacedock.dataset.sources.lerobot import inherited_facts

    return inherited_facts(Path(config.source))


def _seen(config: ConvertConfig, env: SpaceDockConfig | None) -> dict[str, bool]:
    """The options of what a policy saw in the source, where it says: a dataset's own state, else the environment's."""
    if config.format == "lerobot":
        from lerobot_spacedock.dataset.sources.lerobot import observed_options

        return observed_options(Path(config.source))
    return {} if env is None else {"with_mass": env.with_mass, "withhold_pose": env.withhold_pose}


def _select(
    config: ConvertConfig, found: list[EpisodeRef]
) -> tuple[list[EpisodeRef], dict[str, Any], list[tuple[str, str]]]:
    """The episodes that are kept, what is said of how they were chosen, and (episode, reason) of the unreadable."""
    keep = config.num_episodes or len(found)
    if keep > len(found):
        raise InputError("--num_episodes", keep, f"at most {len(found)}, which is all that {config.source} holds")
    as_they_come = config.select == "first" and not config.successes_first
    if as_they_come and not (config.skip_bad and keep < len(found)):  # the first so many that can be read
        return found[:keep], {"kept": keep, "of": len(found), "rule": "first", "rule_text": _rule_text(config)}, []
    refs, scores, successes, left_out = [], [], [], []
    for ref in tqdm(found, unit="episode", desc="Reading"):
        try:
            log = load(ref).log
        except FileFormatError as error:
            if not config.skip_bad:
                raise
            left_out.append((ref.label, reason_of(error, ref)))
            continue
        for rule, name in (("return", "rewards"), ("propellant", "mass")):
            if config.select == rule and name in log.metadata:
                raise InputError("--select", rule, "another rule", f"{ref.label}, {name}: {log.metadata[name]}.")
        refs.append(ref)
        scores.append(score(log, config.select))
        successes.append(succeeded(log))
    kept = best(scores, successes, keep, successes_first=config.successes_first)
    chosen = {"kept": len(kept), "of": len(refs), "rule": config.select, "rule_text": _rule_text(config)}
    return [refs[i] for i in kept], chosen, left_out


def _rule_text(config: ConvertConfig) -> str:
    if not config.num_episodes:
        return "all of them"
    text = RULES[config.select][1]
    return f"successes first, then {text}" if config.successes_first else text
