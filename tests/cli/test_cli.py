"""The ``spacedock`` command: flags in, one clear message out."""

import dataclasses
import importlib
import inspect
import subprocess
import sys

import pytest

from lerobot_spacedock import cli
from lerobot_spacedock.camera.config import CameraConfig
from lerobot_spacedock.errors import InputError


@dataclasses.dataclass(frozen=True)
class Camera:
    height: int = 480  # px


@dataclasses.dataclass(frozen=True)
class Config:
    repo_id: str  # name of the dataset
    num_episodes: int = 10  # how many to keep
    overwrite: bool = False  # replace what is there
    runs: list[str] = dataclasses.field(default_factory=list)  # label=folder
    camera: Camera = dataclasses.field(default_factory=Camera)  # the camera


@dataclasses.dataclass(frozen=True)
class Checked:
    camera: CameraConfig = dataclasses.field(default_factory=CameraConfig)  # the camera


def parse(*arguments):
    return cli.parse_config(Config, arguments, prog="spacedock demos")


def test_flags_reach_nested_fields():
    config = parse("--repo_id=a/b", "--camera.height=96", "--num_episodes", "3")
    assert (config.repo_id, config.camera.height, config.num_episodes) == ("a/b", 96, 3)


def test_a_bare_switch_means_true():
    assert parse("--overwrite", "--repo_id=a/b").overwrite is True
    assert parse("--repo_id=a/b", "--overwrite").overwrite is True
    assert parse("--repo_id=a/b", "--overwrite=false").overwrite is False


@pytest.mark.parametrize(
    "arguments",
    [
        ("--runs", "A=x/y", "B=z,w", "--repo_id=a/b"),
        ("--runs=A=x/y", "--repo_id=a/b", "--runs", "B=z,w"),
        ("--repo_id=a/b", '--runs=["A=x/y", "B=z,w"]'),
    ],
)
def test_a_list_is_given_in_one_place_or_several(arguments):
    assert parse(*arguments).runs == ["A=x/y", "B=z,w"]
    assert parse("--repo_id=a/b", "--runs", "A=x/y").runs == ["A=x/y"]


def test_a_folder_of_the_users_home_is_meant_as_such(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "demos.yaml").write_text("repo_id: from/home\n")
    assert parse("--repo_id=~/data").repo_id == f"{tmp_path}/data"
    assert parse("--config_path=~/demos.yaml").repo_id == "from/home"
    assert parse("--repo_id=a~/b").repo_id == "a~/b"


def test_flags_override_the_config_file(tmp_path):
    path = tmp_path / "demos.yaml"
    path.write_text("repo_id: from/file\nnum_episodes: 7\ncamera:\n  height: 120\n")
    config = parse(f"--config_path={path}", "--num_episodes=8")
    assert (config.repo_id, config.num_episodes, config.camera.height) == ("from/file", 8, 120)


@pytest.mark.parametrize(
    ("arguments", "fragments"),
    [
        (("--repo_id=a", "--num_episode=3"), ("--num_episode=3", "Did you mean --num_episodes?", "--camera.height")),
        (("--repo_id=a", "--num_episodes=many"), ("num_episodes", "many")),
        (("--num_episodes=3",), ("repo_id",)),
        (("--config_path=nowhere.yaml",), ("--config_path", "nowhere.yaml")),
        (("--config_path", "."), ("--config_path: got .;", "YAML")),
        (("--repo_id=a", "--camera.height"), ("--camera.height: got nothing", "--camera.height=…")),
        (("--repo_id",), ("--repo_id: got nothing",)),
        (("--repo_id=a", "--runs"), ("--runs: got nothing",)),
        (("repo_id=a",), ("got repo_id=a;", "Did you mean --repo_id=a?")),
    ],
)
def test_bad_flags_name_the_flag_and_the_remedy(arguments, fragments):
    with pytest.raises(InputError) as caught:
        parse(*arguments)
    for fragment in fragments:
        assert fragment in str(caught.value)


@pytest.mark.parametrize(
    ("verb", "flag", "meant"),
    [
        ("demos", "--env.task=SpaceDockMeta-v0", "Did you mean --env_id?"),
        ("demos", "--env.camera.height=96", "Did you mean --camera.height?"),
        ("demos", "--env.type=spacedock", "lerobot-eval"),
        ("view", "--env.task=SpaceDock-v0", "lerobot-eval"),
        ("demos", "--task=SpaceDockMeta-v0", "The environment is --env_id=SpaceDockMeta-v0."),
    ],
)
def test_the_environments_options_go_by_other_names_here(capsys, tmp_path, verb, flag, meant):
    needed = ["--repo_id=a/b", f"--root={tmp_path / 'set'}"] if verb == "demos" else []
    assert cli.main([verb, *needed, flag]) == 2
    said = capsys.readouterr().err
    assert flag.partition("=")[0] in said
    assert meant in said
    assert "Did you mean --task" not in said


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("view logs/episode_000001.parquet", "--log=logs/episode_000001.parquet"),
        ("view a.parquet", "--log=a.parquet"),
        ("view --save=a.rrd a.parquet", "--log=a.parquet"),
        ("view set.v3", "--dataset=set.v3"),
        ("check set.v3", "--root=set.v3"),
        ("check outputs/cpu/dataset", "--root=outputs/cpu/dataset"),
        ("report outputs/eval/act/episodes", "--runs LABEL=outputs/eval/act/episodes"),
        ("convert rollouts.npz", "--source=rollouts.npz"),
        ("sweep-figure results/sweep_metre.json", "--results=results/sweep_metre.json"),
        ("demos configs/demos_cpu.yaml", "--config_path=configs/demos_cpu.yaml"),
    ],
)
def test_a_path_without_an_option_is_told_which_it_needs(words, meant, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "set.v3").mkdir()
    assert cli.main(words.split()) == 2
    assert f"Did you mean {meant}?" in capsys.readouterr().err


def test_help_of_a_verb_is_found_both_ways(capsys):
    said = []
    for arguments in (["help", "check"], ["check", "--help"]):
        with pytest.raises(SystemExit):
            cli.main(arguments)
        said.append(capsys.readouterr().out)
    assert said[0] == said[1]
    assert "usage: spacedock check" in said[0]
    assert cli.main(["help", "chekc"]) == cli.USAGE_ERROR
    assert "Did you mean check?" in capsys.readouterr().err


def test_a_missing_option_is_named_without_a_list_of_all(capsys):
    assert cli.main(["convert", "--repo_id=a/b"]) == 2
    said = capsys.readouterr().err
    assert "no --source" in said
    assert "--camera" not in said


def test_a_value_of_another_type_is_named_without_a_list_of_all():
    with pytest.raises(InputError, match=r"got --num_episodes=many; allowed: a value of type int") as caught:
        parse("--repo_id=a/b", "--num_episodes=many")
    assert "--camera" not in str(caught.value)


def test_help_says_what_is_required_and_names_each_option_once(capsys):
    with pytest.raises(SystemExit):
        cli.main(["convert", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith("usage: spacedock convert --source=… --repo_id=… [--flag=value ...] Turn rollouts")
    assert "user/name of the dataset (required)" in said
    assert not any(noise in said for noise in ("Config file for", "None", "draccus", "[str]", "Config:", "``"))


def test_a_configs_own_check_is_what_the_user_reads():
    with pytest.raises(InputError, match=r"camera\.height: got 0; allowed: a whole number"):
        cli.parse_config(Checked, ["--camera.height=0"], prog="spacedock demos")


def test_an_option_is_named_as_its_flag_whoever_refuses_it(capsys, tmp_path):
    flown = ["demos", "--repo_id=a/b", f"--root={tmp_path / 'd'}"]
    assert cli.main([*flown, "--initial_conditions=sames"]) == 2
    assert "error: --initial_conditions: got sames" in capsys.readouterr().err
    assert cli.main([*flown, "--camera.height=0"]) == 2
    assert "error: --camera.height: got 0" in capsys.readouterr().err


@pytest.mark.parametrize(("verb", "hint"), [("demos", "the same command goes on"), ("train-expert", "--resume=true")])
def test_a_stopped_command_says_how_to_go_on(verb, hint, capsys, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, "run", interrupted)
    assert cli.main([verb]) == 130
    assert hint in capsys.readouterr().err


def test_an_unknown_key_in_the_config_file_is_named(tmp_path):
    path = tmp_path / "demos.yaml"
    path.write_text("repo_id: a/b\nepisodes: 7\n")
    with pytest.raises(InputError, match="episodes"):
        parse(f"--config_path={path}")


@pytest.mark.parametrize("content", ["just words", '{"a": [', "- a list", "\x00"])
def test_a_file_that_holds_no_options_is_named(tmp_path, content):
    path = tmp_path / "demos.yaml"
    path.write_text(content)
    with pytest.raises(InputError, match=r"--config_path: got .*demos\.yaml.*YAML") as caught:
        parse("--config_path", str(path))
    assert "object" not in str(caught.value)


def test_an_unknown_verb_lists_the_verbs(capsys):
    assert cli.main(["demo"]) == cli.USAGE_ERROR
    message = capsys.readouterr().err
    assert "Did you mean demos?" in message
    assert all(verb in message for verb in cli.VERBS)


def test_no_verb_shows_all_and_fails(capsys):
    for arguments, status in (([], cli.USAGE_ERROR), (["--help"], 0)):
        assert cli.main(arguments) == status
        out = capsys.readouterr().out
        assert all(verb in out for verb in cli.VERBS)


@pytest.mark.parametrize("name", cli.VERBS)
def test_every_verb_is_a_config_and_a_function_of_it(name):
    config_class, function = cli.VERBS[name].load()
    assert dataclasses.is_dataclass(config_class)
    required = [p for p in inspect.signature(function).parameters.values() if p.default is p.empty]
    assert len(required) == 1
    assert importlib.import_module(function.__module__).__name__.startswith("lerobot_spacedock.")


@pytest.mark.parametrize("name", cli.VERBS)
def test_every_flag_of_every_verb_has_a_help_text(name, capsys):
    from draccus.argparsing import ArgumentParser

    config_class, _ = cli.VERBS[name].load()
    with pytest.raises(SystemExit):
        cli.parse_config(config_class, ["--help"], prog=name)
    text = capsys.readouterr().out
    assert all(f"--{field.name}" in text for field in dataclasses.fields(config_class))
    actions = ArgumentParser(config_class, prog=name).parser._actions
    assert [action.option_strings for action in actions if not (action.help or "").strip()] == []


def test_the_command_line_starts_without_lerobot_or_torch():
    code = (
        "import sys; from lerobot_spacedock import cli; cli.main(['--help']);"
        "print(sorted({'torch', 'lerobot', 'numba', 'matplotlib'} & set(sys.modules)))"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip().endswith("[]")


@pytest.mark.parametrize(
    ("content", "arguments", "named"),
    [
        ("repo_id: a/b\ncamera: {heigth: 24}\n", [], ["camera.heigth in", "Did you mean --camera.height"]),
        ("repo_id: a/b\nnum_episode: 2\n", [], ["num_episode in", "Did you mean --num_episodes"]),
        ("repo_id: a/b\nnum_episodes: ten\n", [], ["--num_episodes=ten", "int"]),
        ("", ["--repo_id=a/b", "--num_episodes", "two"], ["--num_episodes=two", "int"]),
        ("", ["--num_episode=3"], ["--num_episode", "Did you mean --num_episodes"]),
        ("", ["--repo_id=a/b", "--num_episodes=1", "extra"], ["got extra"]),
    ],
)
def test_a_mistake_is_named_where_it_stands(tmp_path, content, arguments, named):
    file = tmp_path / "options.yaml"
    file.write_text(content)
    with pytest.raises(InputError) as caught:
        parse(*([f"--config_path={file}"] if content else []), *arguments)
    assert all(word in str(caught.value) for word in named), caught.value


@pytest.mark.parametrize(("word", "lamp"), [("on", "on"), ("off", "off"), ("auto", "auto")])
def test_what_yaml_takes_for_truths_names_the_lamp(word, lamp):
    assert cli.parse_config(Checked, [f"--camera.lamp={word}"], prog="spacedock demos").camera.lamp == lamp
