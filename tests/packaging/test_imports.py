"""What importing costs, and which room may import which."""

import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import lerobot_spacedock

ROOT = Path(__file__).parents[2]
HEAVY = {"numba", "OpenGL", "pyglet", "matplotlib", "rsl_rl", "rerun", "trimesh", "tensordict"}


def loaded_by(statement):
    code = f"import sys; {statement}; print('\\n'.join(sys.modules))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return {name.split(".")[0] for name in result.stdout.split()}


def test_the_package_itself_loads_nothing_heavy():
    assert not (HEAVY | {"torch", "lerobot", "cv2", "scipy"}) & loaded_by("import lerobot_spacedock")


def test_discovery_adds_nothing_heavy_to_what_the_lerobot_command_has_loaded():
    # An import error or a slow import here would be paid by every lerobot command on the machine.
    added = loaded_by(
        "import lerobot.scripts.lerobot_eval as e; before = set(sys.modules); import lerobot_env_spacedock;"
        "[sys.modules.pop(name) for name in before - {'sys'} if name != '__main__']"
    )
    assert "lerobot_spacedock" in added
    assert not HEAVY & added


def test_importing_every_first_level_module_has_no_side_effect():
    # What --env.discover_packages_path=lerobot_spacedock does; in a process of its own, where none is loaded yet.
    names = [module.name for module in pkgutil.iter_modules(lerobot_spacedock.__path__, "lerobot_spacedock.")]
    code = f"import importlib; [importlib.import_module(name) for name in {names!r}]"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert (result.stdout, result.stderr) == ("", "")


def test_an_expert_flies_without_what_trains_it_and_training_says_what_it_needs():
    absent = "import sys; sys.modules['rsl_rl'] = None; sys.modules['tensordict'] = None;"
    flies = "from lerobot_spacedock.expert.meta_rl import MetaRlPolicy; MetaRlPolicy.load()"
    assert "safetensors" in loaded_by(absent + flies)
    code = f"{absent} from lerobot_spacedock.cli import main; sys.exit(main(['train-expert']))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert result.returncode == 2
    assert "pip install '.[expert]'" in result.stderr


@pytest.mark.parametrize("module", sorted(path.stem for path in ROOT.glob("lerobot_env_*.py")))
def test_the_discovered_module_has_the_name_of_the_distribution(module):
    import tomllib

    assert tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["name"] == module


def test_rooms_import_one_way():
    result = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command; lint_imports_command()"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout
    assert "0 broken" in result.stdout
