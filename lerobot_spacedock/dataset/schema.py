"""The one schema of every dataset that this package writes: names, shapes, units and meaning.

Two kinds of columns. What a policy may see or must predict carries LeRobot's prefixes (``observation.``,
``action``); everything else (the true state, the executed command, real times) has none, so that no policy
ever takes it as an input. ``fps`` is 1 and LeRobot's ``timestamp`` counts frames: the step is variable, and
real times stand in ``control_dt`` and ``sim_time``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from lerobot_spacedock.errors import InputError
from lerobot_spacedock.physics.frames import ACTION_NAMES, STATE_NAMES, observed_indices

FPS = 1
ROBOT_TYPE = "spacecraft"
TASK = "dock with the International Space Station"
SCHEMA_VERSION = "1"

IMAGE = "observation.images.camera"
STATE = "observation.state"
ACTION = "action"
EXECUTED_ACTION = "executed_action"
TRUE_STATE = "true_state"
CONTROL_DT = "control_dt"
SIM_TIME = "sim_time"
REWARD = "next.reward"
SUCCESS = "next.success"
DONE = "next.done"

STORAGES = ("video", "image")
LEAST_IMAGE_px = 16
LEAST_VIDEO_WIDTH_px = 32  # the AV1 encoder ends the whole process on narrower frames
STATE_UNITS = ("m",) * 3 + ("m/s",) * 3 + ("kg",) + ("1",) * 4 + ("deg/s",) * 3
ACTION_UNITS = ("N",) * 3 + ("N·m",) * 3

_MEANING = (
    "What the policy sees: position and velocity in Hill axes from the port, quaternion (scalar first, body to Hill), "
    "body rates (against the station in SpaceDock-v0, inertial in the contact tasks); with sensor noise where the "
    "environment has it."
)
_MEANING_WITHHELD = (
    "What the policy sees: velocity in Hill axes and inertial body rates; position and attitude are withheld, the "
    "picture shows them. With sensor noise where the environment has it."
)


@dataclass(frozen=True)
class Column:
    """One feature of the dataset.

    Attributes:
        dtype: LeRobot's dtype.
        shape: as LeRobot writes it.
        names: one a component.
        units: one a component; "1" is dimensionless.
        meaning: one sentence.
    """

    dtype: str
    shape: tuple[int, ...]
    names: tuple[str, ...]
    units: tuple[str, ...]
    meaning: str

    def as_feature(self) -> dict[str, Any]:
        return {"dtype": self.dtype, "shape": self.shape, "names": list(self.names)}


def columns(
    *,
    height: int = 480,
    width: int = 640,
    storage: str = "video",
    with_mass: bool = False,
    withhold_pose: bool = False,
    image: bool = True,
) -> dict[str, Column]:
    """The columns of a dataset, in order.

    Args:
        height: pixels.
        width: pixels.
        storage: ``video`` (streamed to the encoder) or ``image`` (lossless PNG inside Parquet).
        with_mass: 14 observed values, the mass after the velocity, instead of 13.
        withhold_pose: 6 observed values, velocity and rates alone: where it is only the picture shows.
        image: False for a dataset of states alone.

    Raises:
        InputError: unknown storage, or a size that the encoder cannot take.
    """
    if storage not in STORAGES:
        raise InputError("storage", storage, " or ".join(STORAGES))
    video = storage == "video"
    narrow = min(height, width) < LEAST_IMAGE_px or (video and width < LEAST_VIDEO_WIDTH_px)
    if image and (narrow or (video and (height % 2 or width % 2))):
        allowed = f"{LEAST_IMAGE_px} pixels or more; for video even numbers, {LEAST_VIDEO_WIDTH_px} wide or more"
        raise InputError("image size", f"{height}x{width}", allowed, "Give another --camera.height, --camera.width.")
    observed = tuple(STATE_NAMES[i] for i in observed_indices(with_mass=with_mass, withhold_pose=withhold_pose))
    observed_units = tuple(STATE_UNITS[STATE_NAMES.index(name)] for name in observed)
    found: dict[str, Column] = {}
    if image:
        found[IMAGE] = Column(
            storage,
            (height, width, 3),
            ("height", "width", "channels"),
            ("1",),
            "RGB frame of the body camera (+z body axis), taken at the instant of the state.",
        )
    return found | {
        STATE: Column(
            "float32",
            (len(observed),),
            observed,
            observed_units,
            _MEANING_WITHHELD if withhold_pose else _MEANING,
        ),
        ACTION: Column(
            "float32",
            (len(ACTION_NAMES),),
            ACTION_NAMES,
            ACTION_UNITS,
            "The label: the command the expert chose for this observation; thrust and torque, body axes.",
        ),
        CONTROL_DT: Column("float32", (1,), ("dt",), ("s",), "How long the command is held."),
        SIM_TIME: Column("float32", (1,), ("t",), ("s",), "Time since the start of the episode."),
        REWARD: Column("float32", (1,), ("reward",), ("1",), "Reward of the step."),
        SUCCESS: Column("bool", (1,), ("success",), ("1",), "True on the last frame of a successful docking."),
        DONE: Column("bool", (1,), ("done",), ("1",), "True on the last frame of an episode."),
        TRUE_STATE: Column(
            "float32",
            (len(STATE_NAMES),),
            STATE_NAMES,
            STATE_UNITS,
            "The simulator's state without sensor noise, mass included. Never a policy input.",
        ),
        EXECUTED_ACTION: Column(
            "float32",
            (len(ACTION_NAMES),),
            ACTION_NAMES,
            ACTION_UNITS,
            "The command that flew, after injected disturbances and clipping. Never a policy target.",
        ),
    }


def observed_names(size: int) -> tuple[str, ...]:
    """Names of the values of an ``observation.state`` of so many; raises InputError where no such one is known."""
    kinds = [observed_indices(with_mass=mass, withhold_pose=blind) for blind in (False, True) for mass in (False, True)]
    for indices in kinds:
        if len(indices) == size:
            return tuple(STATE_NAMES[i] for i in indices)
    raise InputError(f"{STATE} of so many values", size, " or ".join(str(len(indices)) for indices in kinds))


def features(**options: Any) -> dict[str, dict[str, Any]]:
    """LeRobot's feature dictionary of ``columns(**options)``."""
    return {name: column.as_feature() for name, column in columns(**options).items()}
