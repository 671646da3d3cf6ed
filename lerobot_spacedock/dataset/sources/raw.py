"""The authors' raw export: ``states/trajectory_{j}.csv`` and ``imgs/img_traj_{j}_step_{i}.png``.

One CSV row a state, with the command given in it. The last row has no row after it, so how long its command was held
is unknown: it becomes the terminal state.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lerobot_spacedock.dataset.sources import NO_REWARDS, EpisodeRef, LoadedEpisode
from lerobot_spacedock.dataset.sources.pictures import read_picture
from lerobot_spacedock.episode_log import EpisodeLog
from lerobot_spacedock.errors import FileFormatError
from lerobot_spacedock.physics.frames import ACTION_NAMES, STATE_NAMES

HEADER = ("time", *STATE_NAMES, *ACTION_NAMES)
_TRAJECTORY = re.compile(r"trajectory_(\d+)\.csv")


def list_episodes(path: Path, options: tuple) -> list[EpisodeRef]:
    found = [(int(m[1]), file) for file in (path / "states").glob("*.csv") if (m := _TRAJECTORY.fullmatch(file.name))]
    with_pictures = (path / "imgs").is_dir()
    return [EpisodeRef("raw", str(path), str(j), (*options, ("pictures", with_pictures))) for j, _ in sorted(found)]


def load(ref: EpisodeRef) -> LoadedEpisode:
    folder, j = Path(ref.path), int(ref.key)
    file = folder / "states" / f"trajectory_{j}.csv"
    table = read_table(file)
    time, state = table[:, 0], table[:, 1 : 1 + len(STATE_NAMES)]
    log = EpisodeLog(
        time=time - time[0],
        state=state,
        action=table[:-1, 1 + len(STATE_NAMES) :],
        dt=np.diff(time),
        reward=np.zeros(len(table) - 1),
        metadata={"source": "raw", "trajectory": j, "rewards": NO_REWARDS},
    )
    if not ref.option("pictures"):
        return LoadedEpisode(log)
    files = [folder / "imgs" / f"img_traj_{j}_step_{i}.png" for i in range(log.num_steps)]
    missing = [picture.name for picture in files if not picture.exists()]
    if missing:
        more = f" and {len(missing) - 1} more" if len(missing) > 1 else ""
        raise FileFormatError(f"{folder / 'imgs' / missing[0]}: missing{more}; {file} has {len(table)} rows.")

    def frames(first: int) -> Iterator[np.ndarray]:
        return (read_picture(picture) for picture in files[first:])

    return LoadedEpisode(log, frames)


def read_table(file: Path) -> np.ndarray:
    """The numbers of one trajectory file, (rows, 21), in the order of ``HEADER``.

    Raises:
        FileFormatError: naming the line (the header is line 1) and what is wrong in it.
    """
    with file.open(newline="", encoding="utf-8") as stream:
        reader = csv.reader(stream)
        try:
            header = [name.strip() for name in next(reader, [])]
        except (csv.Error, UnicodeDecodeError) as error:
            raise FileFormatError(f"{file}, line 1: not CSV ({error}).") from error
        missing = [name for name in HEADER if name not in header]
        if missing:
            raise FileFormatError(f"{file}, line 1: columns {missing} are missing; the header is {','.join(HEADER)}.")
        order = [header.index(name) for name in HEADER]
        rows = []
        try:
            for cells in reader:
                if not cells:
                    continue
                place = f"{file}, line {reader.line_num}"
                if len(cells) != len(header):
                    raise FileFormatError(f"{place}: {len(cells)} values, the header has {len(header)}.")
                row = [_number(cells[i], place, header[i]) for i in order]
                if rows and row[0] <= rows[-1][0]:
                    raise FileFormatError(f"{place}: time {row[0]} s does not come after {rows[-1][0]} s.")
                rows.append(row)
        except (csv.Error, UnicodeDecodeError) as error:
            raise FileFormatError(f"{file}, line {reader.line_num}: not CSV ({error}).") from error
    if len(rows) < 3:
        raise FileFormatError(f"{file}: {len(rows)} rows of numbers; an episode has at least 3.")
    return np.array(rows)


def _number(text: str, place: str, column: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise FileFormatError(f"{place}: column {column!r} holds {text!r}, which is not a number.") from None
    if not np.isfinite(value):
        raise FileFormatError(f"{place}: column {column!r} holds {text!r}, which is not finite.")
    return value
