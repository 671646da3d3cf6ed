"""The wheel, built and installed beside nothing but its dependencies: what a user who runs ``pip install`` gets."""

import email
import os
import site
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAME = "lerobot_env_spacedock"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    out = tmp_path_factory.mktemp("dist")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(ROOT)]
    subprocess.run(command, check=True, capture_output=True, text=True)
    (path,) = out.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def environment(wheel, tmp_path_factory):
    """A new virtual environment: the wheel in its own site-packages, the dependencies linked in from this one.

    Everything of this checkout's own installation is left out of the links, so that what is found is the wheel.
    """
    base = tmp_path_factory.mktemp("empty")
    venv.create(base / "venv", with_pip=False, symlinks=True)
    python = base / "venv" / "bin" / "python"
    install = [sys.executable, "-m", "uv", "pip", "install", "--python", str(python), "--no-deps", "--offline"]
    subprocess.run([*install, str(wheel)], check=True, capture_output=True, text=True)
    dependencies = base / "dependencies"
    dependencies.mkdir()
    for folder in site.getsitepackages():
        for entry in Path(folder).iterdir():
            ours = NAME in entry.name or entry.suffix == ".pth"
            if not ours and not (dependencies / entry.name).exists():
                (dependencies / entry.name).symlink_to(entry)
    (own,) = (base / "venv").glob("lib/python3.*/site-packages")
    (own / "dependencies.pth").write_text(f"{dependencies}\n")
    return python, own


def run(python, *arguments, cwd):
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return subprocess.run(
        [str(python), *arguments], cwd=cwd, env=clean, capture_output=True, text=True, timeout=300, check=False
    )


def test_the_raw_name_is_the_one_lerobot_looks_for(wheel):
    with zipfile.ZipFile(wheel) as archive:
        (path,) = [name for name in archive.namelist() if name.endswith(".dist-info/METADATA")]
        metadata = email.message_from_bytes(archive.read(path))
    assert metadata["Name"] == NAME  # underscores: "lerobot-env-spacedock" is never discovered


def test_the_wheel_holds_the_package_and_its_data_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
    roots = {name.split("/")[0] for name in names}
    assert {root for root in roots if not root.endswith(".dist-info")} == {"lerobot_spacedock", f"{NAME}.py"}
    tracked = subprocess.run(
        ["git", "ls-files", "lerobot_spacedock"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    assert set(tracked) <= set(names)
    assert not [name for name in names if "__pycache__" in name or name.endswith((".pkl", ".pt", ".nbi", ".nbc"))]


def test_the_module_that_discovery_imports_comes_from_the_wheel(environment, tmp_path):
    python, own = environment
    code = (
        "import importlib.metadata as m; from importlib.util import find_spec;"
        f"print([d.metadata['Name'] for d in m.distributions() if d.metadata['Name'] == '{NAME}']);"
        f"print(find_spec('lerobot_spacedock').origin); print(find_spec('{NAME}').origin)"
    )
    result = run(python, "-c", code, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    names, package, module = result.stdout.strip().splitlines()[-3:]
    assert names == str([NAME])
    assert Path(package).is_relative_to(own)
    assert Path(module).is_relative_to(own)


def test_stock_lerobot_train_knows_the_env_and_its_options_from_any_folder(environment, tmp_path):
    python, _ = environment
    arguments = ["-m", "lerobot.scripts.lerobot_train", "--env.type=spacedock", "--policy.type=spacedock_mpc", "--help"]
    result = run(python, *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    for text in ("--env.initial_conditions", "--env.camera.height", "--env.log_dir", "--policy.deadline_steps"):
        assert text in result.stdout
    assert "Could not import third-party plugin" not in result.stderr


def test_the_command_is_installed(environment, tmp_path):
    python, _ = environment
    result = run(python.parent / "spacedock", "--version", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith("spacedock ")
