"""What a sweep varies, and how each of its trials is judged."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import Any

from lerobot_spacedock.env.registration import ENV_IDS, withholds_pose
from lerobot_spacedock.env.scenario_config import get_initial_conditions
from lerobot_spacedock.errors import InputError
from lerobot_spacedock.study.demonstrations import (
    FIRST_SEED,
    KINDS,
    SEEDS,
    SEEDS_EACH,
    demos_config,
)
from lerobot_spacedock.study.students import StudentConfig

SAMPLERS = ("grid", "tpe")
# the axes of a sweep, slowest first: fields of SweepConfig that hold a list, and what a trial calls one value of them
AXES = {
    "seeds": "seed",
    "chunk_sizes": "chunk_size",
    "demonstrations": "demonstrations",
    "num_demonstrations": "num_demonstrations",
    "steps": "steps",
    "batch_sizes": "batch_size",
    "learning_rates": "lr",
    "dropouts": "dropout",
    "dim_models": "dim_model",
    "dim_feedforwards": "dim_feedforward",
    "encoder_layers": "n_encoder_layers",
    "vae": "use_vae",
}

# least and most: seeds and numbers of demonstrations beyond these would fly each other's, or those of the evaluation
LIMITS = {
    "seeds": (0, SEEDS - 1),
    "num_demonstrations": (1, SEEDS_EACH),
    "steps": (1, math.inf),
    "batch_sizes": (1, math.inf),
    "dim_models": (1, math.inf),
    "dim_feedforwards": (1, math.inf),
    "encoder_layers": (1, math.inf),
    "chunk_sizes": (1, math.inf),
    "episodes": (1, math.inf),
    "num_trials": (1, math.inf),
    "learning_rates": (1e-12, 1e3),
    "dropouts": (0.0, 0.999),
}


@dataclass
class SweepConfig:
    """Stock ACT from the state over a grid of settings, judged on held-out episodes; resumable by the same command."""

    # name of the study: one a set of axes
    name: str
    # demonstrations, one file a trial, and the journal go here
    output_dir: str = "outputs/study"
    # shared by all machines: a journal file, or an SQLAlchemy URL; by default OUTPUT_DIR/NAME.journal
    storage: str | None = None
    # every finished trial of the study, for git; by default results/sweep_NAME.json
    results: str | None = None
    # grid: every combination once; tpe: num_trials of them, chosen by Optuna for docked share and smoothness
    sampler: str = "grid"
    # how many trials tpe makes
    num_trials: int = 50

    # axis: training seed; each flies demonstrations of its own
    seeds: list[int] = field(default_factory=lambda: [0])
    # axis: kinds of demonstrations: clean | sampled | wide_starts | kicked_same | kicked | kicked_quiet | noisy |
    # terminal | oversampled | sampled_paper | kicked_paper | kicked_hold | kicked_gentle | kicked_W | kicked_V |
    # kicked_mpc | kicked_vision | kicked_meta | kicked_meta_W
    demonstrations: list[str] = field(default_factory=lambda: ["kicked"])
    # axis: how many of them
    num_demonstrations: list[int] = field(default_factory=lambda: [100])
    # axis: training steps
    steps: list[int] = field(default_factory=lambda: [2000])
    # axis: frames a step
    batch_sizes: list[int] = field(default_factory=lambda: [32])
    # axis: peak learning rate of AdamW
    learning_rates: list[float] = field(default_factory=lambda: [5e-4])
    # axis: dropout of ACT
    dropouts: list[float] = field(default_factory=lambda: [0.0])
    # axis: width of ACT
    dim_models: list[int] = field(default_factory=lambda: [96])
    # axis: width of its feed-forward layers
    dim_feedforwards: list[int] = field(default_factory=lambda: [256])
    # axis: layers of its encoder
    encoder_layers: list[int] = field(default_factory=lambda: [1])
    # axis: with or without ACT's variational objective
    vae: list[bool] = field(default_factory=lambda: [False])
    # axis: actions predicted at once
    chunk_sizes: list[int] = field(default_factory=lambda: [5])

    # temporal ensembling of LeRobot (positive: old predictions weigh more); all of them share one training
    coefficients: list[float] = field(default_factory=lambda: [0.01])
    # fly the first action of each new chunk too, without ensembling
    newest: bool = False
    # where a student is judged: ENV_ID/STARTS
    tasks: list[str] = field(
        default_factory=lambda: [
            "SpaceDockContact-v0/same",
            "SpaceDockContact-v0/random",
            "SpaceDockContact-v0/same_dispersed",
            "SpaceDock-v0/same",
        ]
    )
    # episodes of each task
    episodes: int = 100
    # seed of the first; validation, apart from the demonstrations and from lerobot-eval's 1000
    evaluation_seed: int = 900_000

    def __post_init__(self) -> None:
        if self.sampler not in SAMPLERS:
            raise InputError("--sampler", self.sampler, " | ".join(SAMPLERS))
        for kind in self.demonstrations:
            if kind not in KINDS:
                raise InputError("--demonstrations", kind, " | ".join(KINDS))
        for name in (*AXES, "tasks"):
            if not getattr(self, name):
                raise InputError(f"--{name}", [], "one value or more")
        for name, (least, most) in LIMITS.items():
            given = getattr(self, name)
            for value in given if isinstance(given, list) else [given]:
                if not least <= value <= most:
                    allowed = f"{least} or more" if most == math.inf else f"{least:g} to {most:g}"
                    raise InputError(f"--{name}", value, allowed)
        for width in self.dim_models:
            if width % StudentConfig.n_heads:
                raise InputError(
                    "--dim_models", width, f"a multiple of {StudentConfig.n_heads}, the heads of attention"
                )
        for task in self.tasks:
            env_id, _, starts = task.partition("/")
            if env_id not in ENV_IDS:
                raise InputError("--tasks", task, "ENV_ID/STARTS, such as SpaceDockContact-v0/same")
            get_initial_conditions(starts)
            for kind in self.demonstrations:
                if withholds_pose(env_id) != withholds_pose(demos_config(kind, 1, 0).env_id):
                    allowed = "demonstrations of a task that withholds the pose for such tasks, others for the others"
                    raise InputError("--tasks", task, allowed, f"{kind} shows other values of the state.")
        for coefficient in self.coefficients:
            if not abs(coefficient) * (max(self.chunk_sizes) - 1) <= 88.0:  # nan is refused too
                raise InputError(
                    "--coefficients", coefficient, "|coefficient| * (chunk - 1) ≤ 88", "float32 overflows."
                )
        if not self.coefficients and not self.newest:
            raise InputError("--coefficients", [], "one value or more, or --newest")
        if FIRST_SEED - self.episodes < self.evaluation_seed < FIRST_SEED + SEEDS * SEEDS_EACH:
            raise InputError("--evaluation_seed", self.evaluation_seed, "seeds that no demonstration has")

    def axes(self) -> dict[str, list[Any]]:
        """The values of each axis, under a trial's names, slowest first."""
        return {short: list(getattr(self, name)) for name, short in AXES.items()}

    def points(self) -> list[dict[str, Any]]:
        """Every combination of the axes, in the order in which they are run."""
        axes = self.axes()
        return [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]

    @property
    def weightings(self) -> list[float | None]:
        """Coefficients; None is the newest chunk alone."""
        return ([None] if self.newest else []) + list(self.coefficients)
