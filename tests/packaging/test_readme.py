"""Commands in documents and configs can be typed as they stand; files that they name exist."""

import re
import shlex
from pathlib import Path

import draccus
import pytest
from lerobot.configs.eval import EvalPipelineConfig
from lerobot.configs.train import TrainPipelineConfig

import lerobot_spacedock.adapters  # noqa: F401 - registers what the commands name
from lerobot_spacedock import cli

ROOT = Path(__file__).parents[2]
CARDS = sorted((ROOT / "data_cards").rglob("*.md"))
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md")), *CARDS]
CONFIGS = sorted((ROOT / "configs").rglob("*.yaml"))
MADE_BY_AN_EARLIER_STEP = ("outputs/", "CHECKPOINT")


def commands_in(path):
    """Command lines of a document's blocks, or of a config's leading comment; those of loops and of "…" apart."""
    text = path.read_text()
    if path.suffix == ".md":
        fences = re.findall(r"^```(\w*)\n(.*?)^```", text, flags=re.S | re.M)
        blocks = [block for language, block in fences if language in ("", "bash")]
    else:
        comments = [line.removeprefix("#") for line in text.splitlines() if line.startswith("#")]
        blocks = ["\n".join(line.strip() for line in comments if line.startswith("  "))]
    for line in "\n".join(blocks).replace("\\\n", " ").splitlines():
        if re.match(r"(spacedock|lerobot-train|lerobot-eval|make) ", line) and not re.search(r"\$|…|\.\.\.", line):
            yield shlex.split(line, comments=True)


def found(names):
    return [(path, words) for path in [*DOCUMENTS, *CONFIGS] for words in commands_in(path) if words[0] in names]


def check_paths(arguments):
    for argument in arguments:
        path = argument.rpartition("=")[2]
        if "/" in path and path.startswith("configs") and not path.startswith(MADE_BY_AN_EARLIER_STEP):
            assert (ROOT / path).exists(), path


@pytest.mark.parametrize(
    ("path", "words"),
    found(["spacedock"]),
    ids=lambda value: " ".join(value)[:60] if isinstance(value, list) else value.name,
)
def test_every_spacedock_command_parses(path, words, monkeypatch):
    monkeypatch.chdir(ROOT)
    check_paths(words)
    config_class, _ = cli.VERBS[words[1]].load()
    cli.parse_config(config_class, words[2:], prog=words[1])


LEROBOT = {"lerobot-train": TrainPipelineConfig, "lerobot-eval": EvalPipelineConfig}


@pytest.mark.parametrize(
    ("path", "words"), found(LEROBOT), ids=lambda value: " ".join(value)[:60] if isinstance(value, list) else value.name
)
def test_every_lerobot_command_parses(path, words, monkeypatch):
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr("sys.argv", [words[0]])
    check_paths(words)
    flags = [word for word in words[1:] if not word.startswith("--config_path=")]
    if any(flag.startswith("--policy.path=") for flag in flags):  # the checkpoint is of an earlier step; so is its type
        flags = ["--policy.type=act", *(flag for flag in flags if not flag.startswith("--policy.path="))]
    config_path = next((word.partition("=")[2] for word in words if word.startswith("--config_path=")), None)
    draccus.parse(LEROBOT[words[0]], config_path=config_path, args=[*flags, "--policy.device=cpu"])


@pytest.mark.parametrize("path", [path for path in CONFIGS if path.name.startswith("act_")], ids=lambda path: path.name)
def test_training_configs_are_stock_act_that_downloads_and_pushes_nothing(path):
    with draccus.config_type("yaml"):
        config = draccus.parse(TrainPipelineConfig, config_path=path, args=["--policy.device=cpu"])
    assert type(config.policy).__module__.startswith("lerobot.policies.act")
    assert config.policy.pretrained_backbone_weights is None
    assert config.policy.push_to_hub is False
    assert config.policy.n_action_steps == 1
    assert config.policy.temporal_ensemble_coeff == 0.01
    assert not config.wandb.enable


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_and_pictures_are_there(path):
    for target in re.findall(r"\]\(([^)#\s]+)", path.read_text()):
        if not target.startswith(("http:", "https:")):
            assert (path.parent / target).exists(), target


def test_make_targets_in_documents_exist():
    makefile = (ROOT / "Makefile").read_text()
    for path in DOCUMENTS:
        for words in commands_in(path):
            if words[0] == "make":
                assert re.search(rf"^{words[1]}:", makefile, flags=re.M), words
