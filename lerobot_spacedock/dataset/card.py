"""Cards of datasets: generated from the dataset's own files, so that they cannot disagree with them."""

from __future__ import annotations

import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np

from lerobot_spacedock.dataset import schema
from lerobot_spacedock.dataset.env_flags import dataset_env_flags
from lerobot_spacedock.dataset.findings import component_names
from lerobot_spacedock.dataset.licence import license_of
from lerobot_spacedock.dataset.next_commands import evaluate_command, train_command
from lerobot_spacedock.dataset.pictures_check import FrameStore
from lerobot_spacedock.dataset.reader import DatasetReader
from lerobot_spacedock.errors import FileFormatError, reading
from lerobot_spacedock.files import write_text

STRIP_FILE = "frames.jpg"
STRIP_FRAMES = 6
STRIP_HEIGHT_px = 180
MARK = "<!-- card by spacedock -->"  # in every card that was made here
CITATION = """@misc{posadasnava2025action,
  title  = {Action Chunking with Transformers for Image-Based Spacecraft Guidance and Control},
  author = {Posadas-Nava and Scorsoglio and Ghilardi and Furfaro and Linares},
  year   = {2025},
  eprint = {2509.04628},
  archivePrefix = {arXiv}
}"""
_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))


def dataset_card(root: Path, repo_id: str, *, license_id: str | None = None, tags: tuple[str, ...] = ()) -> str:
    """The README of the dataset at ``root``: YAML header for the hub, then Markdown.

    Args:
        root: of the dataset.
        repo_id: user/name.
        license_id: by the hub's short name; left out, that of the source, of which we know no other than our own.
        tags: of the header.
    """
    reader = DatasetReader(root)
    license_id = license_id or license_of(reader.facts)
    stats = _read_stats(root)
    parts = [
        _header(reader, license_id, tags),
        f"# {repo_id.partition('/')[2]}\n\n{_purpose(reader)}",
        f"![frames of one episode, first to last]({STRIP_FILE})" if (root / STRIP_FILE).exists() else "",
        f"## How it was made\n\n{_making(reader)}",
        f"## What is in it\n\n{_contents(reader)}",
        f"## Columns\n\n{_columns(reader)}",
        f"## Statistics\n\n{_statistics(reader, stats)}",
        f"## Use\n\n{_use(reader, repo_id)}",
        f"## Known limitations\n\n{_limits(reader, stats)}",
        f"## Licence and citation\n\nLicence: {license_id}. The task and its reference dynamics are those of\n\n"
        f"```bibtex\n{CITATION}\n```",
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def write_card(root: Path, repo_id: str, *, license_id: str | None = None, tags: tuple[str, ...] = ()) -> Path:
    """Writes the strip of frames and ``README.md`` into the dataset.

    Raises:
        FileFormatError: what the dataset says of itself cannot be used.
    """
    write_strip(DatasetReader(root))
    path = root / "README.md"
    with reading(root, "a dataset that says how it was made"):
        text = dataset_card(root, repo_id, license_id=license_id, tags=tags)
    write_own(path, text)
    return path


def write_own(path: Path, text: str) -> None:
    """Writes a card; one by somebody else that lies there already is kept beside it, as ``README.orig.md``."""
    if path.is_file() and MARK not in path.read_text(encoding="utf-8", errors="replace"):
        names = (f"README.orig{number or ''}.md" for number in itertools.count())
        kept = next(place for name in names if not (place := path.with_name(name)).exists())
        path.replace(kept)
        print(f"{path}: a card that was not made here is kept as {kept.name}")
    write_text(path, f"{text.rstrip()}\n\n{MARK}\n")


def write_strip(reader: DatasetReader) -> Path | None:
    """A strip of frames of the first episode, as ``STRIP_FILE``; None without pictures."""
    if not reader.cameras or not len(reader.lengths):
        return None
    import cv2

    camera = schema.IMAGE if schema.IMAGE in reader.cameras else reader.cameras[0]
    store = FrameStore(reader, camera)
    steps = np.unique(np.linspace(0, reader.lengths[0] - 1, STRIP_FRAMES).round().astype(int))
    frames = [store.frame(0, int(step)) for step in steps]
    height, width = frames[0].shape[:2]
    size = (max(1, round(width * STRIP_HEIGHT_px / height)), STRIP_HEIGHT_px)
    strip = np.hstack([cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in frames])
    path = reader.root / STRIP_FILE
    if not cv2.imwrite(str(path), strip[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90]):
        raise FileFormatError(f"{path}: cannot be written.")
    return path


def _header(reader: DatasetReader, license_id: str, tags: tuple[str, ...]) -> str:
    import yaml

    frames = reader.info["total_frames"]
    size = next((name for limit, name in _SIZES if frames < limit), "n>1M")
    content = {
        "license": license_id,
        "task_categories": ["robotics"],
        "tags": ["LeRobot", "spacecraft", "docking", "guidance-navigation-control", "imitation-learning", *tags],
        "size_categories": [size],
        "configs": [{"config_name": "default", "data_files": "data/*/*.parquet"}],
    }
    return f"---\n{yaml.safe_dump(content, sort_keys=False).strip()}\n---"


def _purpose(reader: DatasetReader) -> str:
    info, facts = reader.info, reader.facts
    expert = (facts.get("expert") or {}).get("name")
    flown = f" flown by `{expert}`" if expert else ""
    return (
        f"{info['total_episodes']} episodes ({info['total_frames']} frames) of a spacecraft that docks with the "
        f"International Space Station{flown}: what a body camera sees, the relative state, and the thrust and torque "
        f"commanded. A LeRobotDataset {info['codebase_version']}, for imitation learning."
    )


def _making(reader: DatasetReader) -> str:
    facts = reader.facts
    if not facts:
        return "Not recorded: the dataset has no `meta/spacedock.json`."
    lines = [f"```\n{facts.get('command', '')}\n```", ""]
    lines += [f"- made by: {facts.get('made_by')}"]
    if facts.get("source"):
        lines.append(f"- source: {facts['source']['description']}")
    if facts.get("source_command"):
        lines.append(f"- which was made by: `{facts['source_command']}`")
    if facts.get("expert"):
        lines.append(f"- expert: {_expert(facts['expert'])}")
    env = facts.get("env")
    if env:
        starts = facts.get("initial_conditions") or [env["initial_conditions"]]
        lines.append(f"- environment: {env['env_id']}, port {env['port']}, starts {', '.join(starts)}")
        lines.append(f"- Sun: {env['sun']}")
    elif facts.get("port"):
        lines.append(f"- port: {facts['port']}")
    if facts.get("expert"):
        lines.append(f"- disturbance of the executed command: {_disturbance(facts.get('disturbance'))}")
    chosen = facts.get("selection")
    if chosen and "flown" in chosen:
        seeds = chosen["seeds"]
        lines.append(f"- selection: {chosen['kept']} of {chosen['flown']} flown: {chosen['rule_text']}")
        lines.append(f"- seeds: {min(seeds)} to {max(seeds)} (each episode's in `meta/spacedock_episodes.parquet`)")
    elif chosen:
        lines.append(f"- selection: {chosen['kept']} of {chosen['of']}: {chosen.get('rule_text', chosen['rule'])}")
    if facts.get("segment", "all") != "all":
        repeats = facts.get("repeat_terminal", 0)
        more = f"; each whole episode is there once, and this part of it {repeats} times more" if repeats else ""
        lines.append(f"- segment: {facts['segment']}{more}")
    if facts.get("times"):
        lines.append(f"- times: {facts['times']}")
    if facts.get("left_out"):
        lines.append(f"- left out, because they could not be read: {len(facts['left_out'])}")
    lines += [f"- {note}" for note in facts.get("notes", [])]
    lines.append(f"- versions: {', '.join(f'{name} {number}' for name, number in facts['versions'].items())}")
    return "\n".join(lines)


def _expert(expert: dict[str, Any]) -> str:
    name, checkpoint = expert["name"], expert.get("checkpoint")
    if not name.startswith("meta_rl"):
        return name
    trained = expert.get("training") or {}
    counts = f", trained in {trained['episodes']:,} episodes" if trained.get("episodes") else ""
    return f"{name}, checkpoint {checkpoint or 'the default one that ships'}{counts}"


def _disturbance(given: dict[str, Any] | None) -> str:
    if not given:
        return "none"
    kicks, noise = given["kicks"], given["noise"]
    parts = []
    if kicks["probability"] > 0.0:
        parts.append(
            f"kicks of one step with probability {kicks['probability']:g} a step ({kicks['thrust_N']:g} N and "
            f"{kicks['torque_Nm']:g} N·m, one sigma an axis; none within {kicks['quiet_m']:g} m of the port)"
        )
    if noise["thrust_N"] > 0.0 or noise["torque_Nm"] > 0.0:
        parts.append(
            f"AR(1) noise, correlation {noise['correlation']:g} ({noise['thrust_N']:g} N, {noise['torque_Nm']:g} N·m)"
        )
    return "; ".join(parts) + ". The label is the expert's clean command; what flew is in `executed_action`"


def _contents(reader: DatasetReader) -> str:
    lengths = reader.lengths
    lines = [
        "| | |",
        "|---|---|",
        f"| episodes | {len(lengths)} |",
        f"| frames | {int(lengths.sum())} |",
        f"| frames an episode | {_span(lengths.min(), lengths.max())}, mean {lengths.mean():.1f} |",
    ]
    if reader.about is not None:
        docked = int(reader.about.column("success").sum())
        lines.append(f"| docked inside the IDSS box | {docked} of {len(reader.about)} |")
        miss = 1e2 * np.hypot(reader.about.column("terminal_x"), reader.about.column("terminal_z"))
        lines.append(f"| lateral distance at the end | median {np.median(miss):.1f} cm, worst {np.max(miss):.1f} cm |")
    for camera in reader.cameras:
        feature = reader.features[camera]
        height, width = feature["shape"][:2]
        how = "lossless PNG" if feature["dtype"] == "image" else _codec(feature)
        lines.append(f"| pictures | {height} × {width}, {how} |")
    size = sum(file.stat().st_size for file in reader.root.rglob("*") if file.is_file() and ".cache" not in file.parts)
    lines.append(f"| size | {size / 1e6:.1f} MB |")
    return "\n".join(lines)


def _span(least: int, most: int) -> str:
    return f"{least}" if least == most else f"{least} to {most}"


def _codec(feature: dict[str, Any]) -> str:
    info = feature.get("info") or {}
    crf = f", crf {info['video.crf']}" if info.get("video.crf") is not None else ""
    return f"video ({info.get('video.codec', 'unknown codec')}{crf})"


def _columns(reader: DatasetReader) -> str:
    described = reader.facts.get("columns", {})
    lines = ["| column | type | components | unit | meaning |", "|---|---|---|---|---|"]
    for name, feature in reader.features.items():
        if name in ("frame_index", "episode_index", "index", "task_index", "timestamp"):
            continue
        about = described.get(name, {})
        shape = "×".join(map(str, feature["shape"]))
        names = ", ".join(component_names(feature) or [])
        units = ", ".join(dict.fromkeys(about.get("units", [])))
        lines.append(f"| `{name}` | {feature['dtype']} {shape} | {names} | {units} | {about.get('meaning', '')} |")
    timed = schema.CONTROL_DT in reader.features
    times = "the real times are in `control_dt` and `sim_time`" if timed else "real times are not in it"
    lines.append("")
    lines.append(
        f"`fps` is {reader.info['fps']} and `timestamp` counts frames, because LeRobot stores frames at a fixed rate; "
        f"{times}. Hill frame: x radial outward, y along-track, z orbit normal, origin at the docking port. "
        "Quaternions are scalar first and turn body vectors into Hill vectors."
    )
    return "\n".join(lines)


def _statistics(reader: DatasetReader, stats: dict[str, Any]) -> str:
    lines = ["| component | mean | std | min | max |", "|---|---|---|---|---|"]
    for name in (schema.STATE, schema.ACTION, schema.CONTROL_DT):
        if name not in reader.features or name not in stats:
            continue
        names = component_names(reader.features[name]) or []
        columns = [np.ravel(stats[name][key]) for key in ("mean", "std", "min", "max")]
        for index, row in enumerate(zip(*columns, strict=True)):
            label = names[index] if index < len(names) else str(index)
            lines.append(f"| {name}: {label} | " + " | ".join(f"{value:.5g}" for value in row) + " |")
    return "\n".join(lines)


def _use(reader: DatasetReader, repo_id: str) -> str:
    parts = [train_command(reader, repo_id)] + ([evaluate_command(reader)] if reader.cameras else [])
    commands = "\n".join(" \\\n    ".join(lines) for lines in parts)
    if reader.cameras:
        said = (
            "A chunk of 5 and a new prediction every step: with ACT's own defaults, 100 actions flown to their end, it "
            "would fly most of the approach blind."
        )
    else:
        said = (
            "Stock ACT refuses a state alone: this draws the pictures (`FOLDER` is where the dataset was downloaded "
            "to), and the card of what comes out says how to train on it. The environment that shows a policy of your "
            f"own the same as this dataset: `{' '.join(dataset_env_flags(reader))}`."
        )
    return f"With LeRobot and its plugin `lerobot_env_spacedock` installed:\n\n```bash\n{commands}\n```\n\n{said}"


def _limits(reader: DatasetReader, stats: dict[str, Any]) -> str:
    lines = [
        "- Synthetic: drawn pictures, Hill–Clohessy–Wiltshire motion about a circular orbit, a rigid body, ideal "
        "thrusters."
    ]
    env = reader.facts.get("env") or {}
    if env.get("sun") == "fixed":
        lines.append("- One direction of sunlight: a policy trained on it has seen no other.")
    if env.get("dynamics") == "nominal":
        lines.append("- One chaser: mass, inertia and thrusters are the nominal ones, and the state is exact.")
    if not reader.facts.get("disturbance") and reader.facts.get("made_by") == "spacedock demos":
        lines.append("- Clean demonstrations: they do not show how to come back from a disturbed state.")
    for name in (schema.STATE, schema.ACTION):
        spread = np.ravel(stats.get(name, {}).get("std", []))
        names = component_names(reader.features[name]) or [str(i) for i in range(len(spread))]
        flat = [names[i] for i in np.flatnonzero(spread < 1e-7)]
        if flat:
            lines.append(f"- `{name}` has no spread in {', '.join(flat)}.")
    if reader.about is not None:
        failed = len(reader.about) - int(reader.about.column("success").sum())
        if failed:
            lines.append(f"- {failed} of {len(reader.about)} episodes do not end inside the IDSS box.")
    return "\n".join(lines)


def _read_stats(root: Path) -> dict[str, Any]:
    path = root / "meta" / "stats.json"
    return json.loads(path.read_text()) if path.exists() else {}
