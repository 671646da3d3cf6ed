"""One reader under Atheris, whose mutations are led by what they reach in our code and in the libraries' Python:

    pip install '.[fuzz]'
    python tests/fuzz/atheris_readers.py --reader=NPZ --inputs=20000 --corpus=outputs/fuzz/npz

Judged as ``run.py`` judges (errors of this package alone, no forbidden act, 2 s, 1 GiB); the first input that fails
ends it and is kept as ``crash-…`` in the folder where it was started. The corpus grows from run to run.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import atheris

INSTRUMENTED = ["lerobot_spacedock", "zipfile", "csv", "numpy.lib", "trimesh", "safetensors", "h5py", "PIL", "yaml"]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reader", required=True, help="a word of its name, as run.py lists them")
    parser.add_argument("--inputs", type=int, default=20_000, help="how many to try")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--corpus", type=Path, help="folder to begin from and to add to; a temporary one by default")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        child = os.fork()  # libFuzzer ends its process, which would leave the folder behind
        if child == 0:
            run(options.reader, Path(name), options.corpus or Path(name) / "corpus", options.inputs, options.seed)
        _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status)


def run(wanted: str, folder: Path, corpus: Path, inputs: int, seed: int) -> None:
    """Never returns."""
    with atheris.instrument_imports(include=INSTRUMENTED):
        import guard
        from readers import READERS

        (reader,) = [reader for reader in READERS if wanted.lower() in reader.name.lower()]
        work = folder / "work"
        work.mkdir()
        corpus.mkdir(parents=True, exist_ok=True)
        files = [file for file, _ in reader.make(work)]
        for number, file in enumerate(files):
            reader.read(file)  # what is imported late is imported, and instrumented, now
            (corpus / f"good_{number}").write_bytes(file.read_bytes())
    guarded, longest = guard.Guard(work), 4 * max(file.stat().st_size for file in files)
    guard.limit_memory()

    def one(data: bytes) -> None:
        files[0].write_bytes(data)
        try:
            with guarded.watching():
                reader.read(files[0])
        except reader.allowed:
            pass
        if guarded.seen:
            raise AssertionError(guarded.seen)

    # no timer of its own: the guard has one; nor its limit of memory, which would count the libraries
    limits = ["-timeout=0", "-rss_limit_mb=0", f"-max_len={longest}", f"-seed={seed}"]
    atheris.Setup([sys.argv[0], f"-runs={inputs}", *limits, str(corpus)], one)
    atheris.Fuzz()


if __name__ == "__main__":
    sys.exit(main())
