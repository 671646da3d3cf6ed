"""Hostile inputs from good ones: bytes changed anywhere, or values changed where the format's framing stays whole."""

from __future__ import annotations

import io
import json
import struct
import zlib
from typing import Any

import numpy as np

NUMBERS = (b"nan", b"inf", b"-1", b"0", b"1e999", b"-1e-400", b"99999999999999999999", b"0x10", b"1_0", b"", b"true")
TOKENS = (b"\x00", b"\xff\xff\xff\xff", b"\x7f\xff\xff\xff", b"../../../etc/passwd", b"{", b"}", b"[" * 50, b'"', b"\n")
TOKENS += (
    b"!!python/object/apply:os.system ['true']\n",
    b"&a [*a]\n",
    b"\xef\xbb\xbf",
    b",",
    b"%s%n",
    b"\xc0\x80",
    b"[" * 100_000,
)
VALUES = (None, True, False, 0, -1, 1e308, -1e-320, 2**63, 10**30, "", "x" * 300, "nan", "\x00", [], {}, [[]], [None])
VALUES += ("../../../etc/passwd", "/etc/passwd", {"a": {"b": []}}, [1, "a", None], 0.5, 3, "meta_rl", "2024", "{chunk}")

MILLIONS = 3_000_000


def mutate_bytes(rng: np.random.Generator, data: bytes) -> bytes:
    """One to four edits: bits, bytes, cuts, copies, tokens, integers; sometimes a cut end or nothing at all."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 5))):
        at, length = int(rng.integers(0, len(out) + 1)), int(rng.geometric(0.08))
        match int(rng.integers(0, 9)):
            case 0 if out:
                out[at % len(out)] ^= 1 << int(rng.integers(0, 8))
            case 1 if out:
                out[at % len(out)] = int(rng.integers(0, 256))
            case 2:
                del out[at : at + length]
            case 3:
                out[at:at] = out[at : at + length]
            case 4:
                out[at:at] = TOKENS[int(rng.integers(len(TOKENS)))]
            case 5:
                out[at : at + length] = NUMBERS[int(rng.integers(len(NUMBERS)))]
            case 6:
                value = int(rng.choice([0, 1, -1, 2**31 - 1, -(2**31), 2**20]))
                out[at : at + 4] = struct.pack("<i", value)
            case 7:
                del out[at:]
            case _:
                out[at : at + length] = rng.bytes(length)
    return bytes(out)


def mutate_json(rng: np.random.Generator, value: object) -> object:
    """The same document with one to three of its nodes replaced, removed, doubled or renamed."""
    for _ in range(int(rng.integers(1, 4))):
        value = _mutate_node(rng, value)
    return value


def _mutate_node(rng: np.random.Generator, value: object) -> object:
    if not isinstance(value, dict | list) or not value or rng.random() < 0.1:
        return VALUES[int(rng.integers(len(VALUES)))]
    keys = list(value) if isinstance(value, dict) else list(range(len(value)))
    key = keys[int(rng.integers(len(keys)))]
    changed = value.copy()
    action = rng.random()
    if action < 0.15:
        del changed[key]
    elif action < 0.25 and isinstance(changed, dict):
        changed[str(VALUES[int(rng.integers(len(VALUES)))])] = changed.pop(key)
    elif action < 0.3 and isinstance(changed, list):
        changed = changed * 3
    else:
        changed[key] = _mutate_node(rng, value[key])
    return changed


def json_text(rng: np.random.Generator, data: bytes) -> bytes:
    return json.dumps(mutate_json(rng, json.loads(data))).encode()


def json_lines(rng: np.random.Generator, data: bytes) -> bytes:
    lines = data.splitlines()
    at = int(rng.integers(len(lines)))
    lines[at] = json_text(rng, lines[at])
    return b"\n".join(lines)


def yaml_text(rng: np.random.Generator, data: bytes) -> bytes:
    import yaml

    return yaml.safe_dump(mutate_json(rng, yaml.safe_load(data)), allow_unicode=True).encode("utf-8", "surrogateescape")


def csv_text(rng: np.random.Generator, data: bytes) -> bytes:
    """Cells replaced, rows and columns taken out, doubled or moved."""
    rows = [line.split(b",") for line in data.splitlines()]
    for _ in range(int(rng.integers(1, 4))):
        row = int(rng.integers(len(rows)))
        cell = int(rng.integers(len(rows[row]))) if rows[row] else 0
        match int(rng.integers(0, 5)):
            case 0 | 1 if rows[row]:
                rows[row][cell] = NUMBERS[int(rng.integers(len(NUMBERS)))]
            case 2:
                rows.insert(int(rng.integers(len(rows) + 1)), list(rows[row]))
            case 3 if len(rows) > 1:
                rows.pop(row)
            case _:
                rows[row] = rows[row][:cell]
    return b"\n".join(b",".join(row) for row in rows)


def png_header(rng: np.random.Generator, data: bytes) -> bytes:
    """Another size, depth or colour type, with a right checksum: a small file that asks for a huge picture."""
    width, height = (int(rng.choice([0, 1, 7, 1000, 50_000, 2**31 - 1])) for _ in range(2))
    body = struct.pack(">IIBBBBB", width, height, *(int(v) for v in rng.choice([0, 1, 2, 3, 4, 6, 8, 16], 2)), 0, 0, 0)
    chunk = b"IHDR" + body
    return data[:12] + chunk + struct.pack(">I", zlib.crc32(chunk)) + data[33:]


def glb_json(rng: np.random.Generator, data: bytes) -> bytes:
    """The JSON chunk of a binary glTF changed, lengths kept right."""
    length = struct.unpack("<I", data[12:16])[0]
    text = json.dumps(mutate_json(rng, json.loads(data[20 : 20 + length]))).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    size = 20 + len(text) + len(rest)
    return data[:8] + struct.pack("<II", size, len(text)) + b"JSON" + text + rest


def safetensors_header(rng: np.random.Generator, data: bytes) -> bytes:
    """The header of a safetensors file changed, its length kept right."""
    length = struct.unpack("<Q", data[:8])[0]
    text = json.dumps(mutate_json(rng, json.loads(data[8 : 8 + length]))).encode()
    return struct.pack("<Q", len(text)) + text + data[8 + length :]


def arrays(rng: np.random.Generator, found: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays of other shapes, types and values; objects among them."""
    names = list(found)
    name = names[int(rng.integers(len(names)))]
    changed, value = dict(found), found[name]
    match int(rng.integers(0, 8)):
        case 0:
            del changed[name]
        case 1:
            changed[name] = value.astype(rng.choice(["f2", "i8", "u1", "U5", "S3", "c16", "?"]))
        case 2:
            changed[name] = value[: int(rng.integers(0, len(value) + 1))] if value.ndim else value.reshape(1)
        case 3:
            changed[name] = value.reshape(-1)
        case 4:
            changed[name] = np.full_like(value, rng.choice([0, 1, 200])) if value.dtype.kind == "u" else value * np.nan
        case 5:
            changed[name] = np.array([{"a": print}, None], dtype=object)
        case 6:
            changed[name] = np.float64(rng.choice([0.0, -1.0, np.inf, 1e300]))
        case _:
            changed[str(VALUES[int(rng.integers(len(VALUES)))])] = value
    return changed


def npz(rng: np.random.Generator, data: bytes) -> bytes:
    """An archive of changed arrays, or one whose header claims far more than it holds."""
    with np.load(io.BytesIO(data), allow_pickle=False) as stored:
        found = {name: stored[name] for name in stored.files}
    out = io.BytesIO()
    if rng.random() < 0.2:
        import zipfile

        header = {"descr": "<f8", "fortran_order": False, "shape": (int(rng.choice([10**4, 10**8, 10**10, 2**40])), 14)}
        member = io.BytesIO()
        np.lib.format.write_array_header_1_0(member, header)
        with zipfile.ZipFile(out, "w") as archive:
            archive.writestr("state.npy", member.getvalue() + b"\x00" * 64)
            archive.writestr("action.npy", member.getvalue())
        return out.getvalue()
    changed = {name: value for name, value in arrays(rng, found).items() if name.isidentifier()}
    np.savez(out, **changed)
    return out.getvalue()


def hdf5(rng: np.random.Generator, data: bytes) -> bytes:
    """Datasets changed, made groups, links that lead out, or of a size that no data stands behind."""
    import h5py

    with h5py.File(io.BytesIO(data), "r") as stored:
        names: list[str] = []
        stored.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        found = {name: stored[name][()] for name in names}
    out = io.BytesIO()
    name = names[int(rng.integers(len(names)))]
    with h5py.File(out, "w") as file:
        kind = rng.random()
        images = found.get("observations/images/camera")
        if images is not None and images.ndim == 2:  # encoded pictures
            row = int(rng.integers(len(images)))
            damaged = (png_header if rng.random() < 0.5 else mutate_bytes)(rng, images[row].tobytes())
            images[row] = np.frombuffer(damaged.ljust(images.shape[1], b"\0"), np.uint8)[: images.shape[1]]
        changed = arrays(rng, found) if kind < 0.6 else {k: v for k, v in found.items() if k != name}
        for key, value in changed.items():
            if np.asarray(value).dtype.kind in "fiub" and key.replace("/", "").isidentifier():
                file[key] = value
        if kind < 0.6:
            pass
        elif kind < 0.7:
            file.create_dataset(name, (int(rng.choice([10**4, 10**9, 10**11])), 14), "f8", chunks=(64, 14))
        elif kind < 0.8:
            file[name] = h5py.ExternalLink("/etc/hostname", "/x")
        elif kind < 0.9:
            file.create_group(name)
        else:
            file[name] = h5py.SoftLink("/nowhere")
    return out.getvalue()


def _millions(column: Any) -> Any:
    """Three million rows of a column's first value: next to nothing on disk."""
    import pyarrow as pa

    first = column.slice(0, 1).combine_chunks()
    if pa.types.is_nested(first.type):
        return pa.nulls(MILLIONS, first.type)
    return pa.DictionaryArray.from_arrays(pa.array(np.zeros(MILLIONS, np.int8)), first).cast(first.type)


def parquet(rng: np.random.Generator, data: bytes) -> bytes:
    """Columns taken out, doubled, of other types, with nulls and values that are no states; other metadata."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(io.BytesIO(data))
    names = table.column_names
    at = int(rng.integers(len(names)))
    metadata = dict(table.schema.metadata or {})
    match int(rng.integers(0, 8)):
        case 0 if rng.random() < 0.1:
            table = pa.table({name: _millions(table.column(name)) for name in names})
        case 0:
            table = table.drop_columns([names[at]])
        case 1:
            value = VALUES[int(rng.integers(len(VALUES)))]
            column = pa.array([value if isinstance(value, str) else repr(value)] * table.num_rows)
            table = table.set_column(at, names[at], column)
        case 2 if pa.types.is_floating(table.schema.types[at]):
            values = table.column(at).to_numpy().copy()
            values[int(rng.integers(len(values)))] = rng.choice([np.nan, np.inf, 0.0, -1e300, 1e300, 1e-320])
            table = table.set_column(at, names[at], pa.array(values))
        case 3:
            table = table.slice(0, int(rng.integers(0, 3)))
        case 4:
            table = table.set_column(at, names[at], pa.array([[1.0, None]] * table.num_rows))
        case 5:
            table = table.set_column(at, names[at], pa.nulls(table.num_rows))
        case 6:
            table = pa.concat_tables([table] * 2 + [table.slice(int(rng.integers(0, table.num_rows + 1)))])
        case _:
            for key, text in metadata.items():
                try:
                    metadata[key] = json.dumps(mutate_json(rng, json.loads(text))).encode()
                except ValueError:
                    metadata[key] = mutate_bytes(rng, text)
    out = io.BytesIO()
    pq.write_table(table.replace_schema_metadata(metadata), out)
    return out.getvalue()
