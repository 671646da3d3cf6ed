"""A whole report from logs on disk: its numbers against NumPy and SciPy, its files, and what it says of odd input."""

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from scipy import stats
from synthetic_logs import fly, write_run

from lerobot_spacedock.cli import main
from lerobot_spacedock.episode_log import iterate_episode_logs, log_path, write_episode_log
from lerobot_spacedock.errors import FileFormatError, InputError
from lerobot_spacedock.metrics.collect import collect
from lerobot_spacedock.report.build import ReportConfig, load_study, report
from lerobot_spacedock.report.comparison_tables import matched_table, pairs_table, seeds_table
from lerobot_spacedock.report.docking_tables import at_a_glance
from lerobot_spacedock.report.figures.style import panel_svgs
from lerobot_spacedock.report.page import render_page
from lerobot_spacedock.report.runs import log_files, parse_runs
from lerobot_spacedock.report.table import Cell, Table, number, p_value, percent, to_json, to_latex, to_markdown
from lerobot_spacedock.report.write import make_figures, make_tables


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    root = tmp_path_factory.mktemp("logs")
    write_run(root / "act", range(1000, 1012), jitter=1.0)
    write_run(root / "rl", range(1000, 1012), jitter=4.0, gain=0.95)
    write_run(root / "act", range(2000, 2003), jitter=1.0, initial_conditions="random")
    write_run(root / "act" / "surplus", range(3000, 3002), jitter=1.0)
    (root / "rl" / "episode_009999.parquet").write_bytes(b"PAR1 cut short")
    (root / "expert.json").write_text(json.dumps({"training": {"episodes": 655, "interactions": 52_400}}))
    (root / "demos" / "meta").mkdir(parents=True)
    (root / "demos" / "meta" / "info.json").write_text(json.dumps({"total_episodes": 100, "total_frames": 6539}))
    (root / "demos" / "meta" / "spacedock.json").write_text(json.dumps({"selection": {"kept": 100, "flown": 150}}))
    return root


@pytest.fixture(scope="module")
def page(logs, tmp_path_factory):
    out = tmp_path_factory.mktemp("report")
    words = ["report", "--runs", f"ACT={logs / 'act'}", f"RL={logs / 'rl'}", f"--out={out}", "--resamples=200"]
    words += ["--training", f"ACT={logs / 'expert.json'}", "--demos", f"ACT={logs / 'demos'}"]
    assert main(words) == 0
    return out


@pytest.fixture(scope="module")
def numbers(page):
    def refuse(constant):
        raise AssertionError(f"{constant} in the JSON")

    return json.loads((page / "report.json").read_text(), parse_constant=refuse)


def row(numbers, table, **where):
    (found,) = [r for r in numbers["tables"][table]["rows"] if all(r[k] == v for k, v in where.items())]
    return found


def final_states(folder, conditions):
    picked = [log for _, log in iterate_episode_logs(folder) if log.metadata["initial_conditions"] == conditions]
    return np.array([log.state[-1] for log in picked]), picked


def test_table_3_is_the_percentiles_of_the_last_states(logs, numbers):
    last, _ = final_states(logs / "act", "same")
    distance, speed = np.linalg.norm(last[:, :3], axis=1), np.linalg.norm(last[:, 3:6], axis=1)
    ours = row(numbers, "table3", set="same", method="ACT")
    assert ours["n"] == 12
    assert ours["‖r_K‖ mean (m)"] == pytest.approx(distance.mean())
    for part in (75, 95, 99):
        assert ours[f"‖r_K‖ {part} % (m)"] == pytest.approx(np.percentile(distance, part))
        assert ours[f"‖v_K‖ {part} % (m/s)"] == pytest.approx(np.percentile(speed, part))


def test_the_papers_numbers_stand_beside_ours(numbers):
    paper = row(numbers, "table3", set="same", method="ACT, paper")
    assert [paper[k] for k in list(paper)[3:]] == [0.992, 1.326, 1.763, 2.248, 0.086, 0.112, 0.141, 0.159]
    recomputed = row(numbers, "table4", set="mixed")
    assert round(recomputed["df"]) == 135
    assert row(numbers, "table1", method="RL, paper")["training episodes"] == 63_000
    assert len(numbers["errata"]) >= 8


def test_table_4_is_eq_4_and_welchs_test(logs, numbers):
    values = []
    for name in ("act", "rl"):
        picked = [log for _, log in iterate_episode_logs_readable(logs / name)]
        values.append([np.linalg.norm(np.diff(log.action, axis=0), axis=1).mean() for log in picked])
    reference = stats.ttest_ind(*values, equal_var=False)
    pair = row(numbers, "table4", **{"set": "same", "method, or pair": "ACT − RL"})
    assert (pair["Welch t"], pair["df"], pair["p"]) == pytest.approx(
        (reference.statistic, reference.df, reference.pvalue)
    )
    mine = row(numbers, "table4", **{"set": "same", "method, or pair": "ACT"})
    assert mine["mean ± std"] == {
        "mean": pytest.approx(np.mean(values[0])),
        "std": pytest.approx(np.std(values[0], ddof=1)),
    }


def iterate_episode_logs_readable(folder):
    from lerobot_spacedock.episode_log import read_episode_log

    for path in sorted(folder.glob("episode_001*.parquet")):
        yield path, read_episode_log(path)


def test_sample_efficiency_counts_the_expert_and_the_demonstrations(numbers):
    ours = row(numbers, "table1", method="ACT")
    assert ours["training interactions"] == 52_400
    assert ours["demonstration interactions"] == 6539
    assert ours["all interactions"] == 52_400 + 6539
    assert any("100 demonstrations kept of 150 flown" in note for note in numbers["tables"]["table1"]["notes"])
    assert row(numbers, "table1", method="RL")["training interactions"] is None


def test_nothing_is_dropped_without_a_word(page, numbers):
    act, rl = numbers["runs"]
    assert [(name, s["episodes"]) for name, s in act["sets"].items()] == [("same", 12), ("random", 3)]
    assert [x["reason"].split()[0] for x in act["excluded"]] == ["surplus", "surplus"]
    assert "not readable" in rl["excluded"][0]["reason"]
    for text in ((page / "report.md").read_text(), (page / "index.html").read_text()):
        assert "episode_009999.parquet" in text
        assert "surplus" in text


def test_runs_on_the_same_starts_get_paired_tests_and_the_counts_are_right(numbers):
    matched = [r for r in numbers["tables"]["matched"]["rows"] if r["set"] == "same"]
    assert {r["pairs"] for r in matched} == {12}
    assert {r["test"] for r in matched} == {"Wilcoxon signed-rank", "McNemar exact"}
    assert all(r["p"] <= r["p, Holm"] for r in matched)


def test_every_file_is_there_and_whole(page):
    from PIL import Image

    pictures = sorted((page / "figures").glob("*.png"))
    assert {p.stem for p in pictures} >= {f"figure{k}_same" for k in range(3, 8)} | {"contact_same", "closing_same"}
    for picture in pictures:
        image = np.asarray(Image.open(picture).convert("L"))
        assert image.std() > 5, f"{picture.name} is blank"
        assert picture.with_suffix(".svg").stat().st_size > 1000
    text = (page / "report.md").read_text()
    for target in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text):
        assert (page / target).is_file()
    latex = (page / "tables.tex").read_text()
    assert latex.count(r"\begin{tabular}") == latex.count(r"\end{tabular}") >= 14
    set_in_type = "\n".join(line for line in latex.splitlines() if not line.lstrip().startswith("%"))
    assert not re.search(r"[‖Δ°≤±·−–δ∈†“”α]", set_in_type)


class Page(HTMLParser):
    VOID = frozenset({"meta", "br", "link", "img"})

    def __init__(self):
        super().__init__()
        self.links, self.ids, self.outside = [], [], []

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        self.ids += [attributes["id"]] if "id" in attributes else []
        for name in ("src", "href", "xlink:href"):
            target = attributes.get(name)
            if target and target.startswith("#"):
                self.links.append(target[1:])
            elif target:
                self.outside.append(target)


def test_the_page_is_self_contained_and_its_links_lead_somewhere(page):
    text = (page / "index.html").read_text()
    parsed = Page()
    parsed.feed(text)
    assert not [t for t in parsed.outside if not t.startswith("data:")]
    assert "@import" not in text
    assert set(parsed.links) <= set(parsed.ids)
    assert len(set(parsed.ids)) == len(parsed.ids), "an id twice: one figure would borrow another's clip path"
    for reference in re.findall(r"url\(#([^)]+)\)", text):
        assert reference in parsed.ids


def test_the_same_logs_give_the_same_page(logs, page, tmp_path):
    cfg = ReportConfig(runs=[f"ACT={logs / 'act'}", f"RL={logs / 'rl'}"], out=tmp_path, resamples=200)
    again = {table.key: to_markdown(table) for table in make_tables(load_study(cfg), cfg)}
    text = (page / "report.md").read_text()
    assert again["pairs"].strip() in text
    assert again["intervals"].strip() in text


def test_many_processes_read_what_one_reads(logs):
    files = [log_files(logs / "act"), log_files(logs / "rl")] * 3
    alone, _ = collect(files, workers=1)
    together, left_out = collect(files, workers=2)
    assert len(left_out) == 9
    for conditions, episodes in alone.items():
        assert together[conditions].names == episodes.names
        for name, column in episodes.columns.items():
            np.testing.assert_array_equal(together[conditions].columns[name], column)
        np.testing.assert_array_equal(together[conditions].visits["yx"].counts, episodes.visits["yx"].counts)


@pytest.fixture(scope="module")
def odd_runs(tmp_path_factory):
    root = tmp_path_factory.mktemp("odd")
    write_run(root / "one", range(1))
    for seed in range(4):
        write_episode_log(log_path(root / "equal", seed), fly(7))
    write_run(root / "far", range(3), gain=-1.0)
    for seed, steps in enumerate((0, 1, 2, 30)):
        write_episode_log(log_path(root / "short", seed), fly(seed, steps=steps))
    for seed in range(3):
        log = fly(seed)
        log.metadata.clear()
        write_episode_log(log_path(root / "bare", seed), log)
    return root


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_degenerate_runs_make_every_table_and_figure(odd_runs):
    """One episode; equal episodes; fly-aways; episodes of 0, 1 and 2 steps; logs without metadata."""
    cfg = ReportConfig(runs=[f"{path.name}={path}" for path in sorted(odd_runs.iterdir())], resamples=100)
    study = load_study(cfg)
    assert study.conditions() == ["same", "unspecified"]
    for table in make_tables(study, cfg):
        assert not re.search(r"\bnan\b|\binf\b", to_markdown(table)), table.key
        json.dumps(to_json(table), allow_nan=False)
    for figure in make_figures(study):
        for svg in panel_svgs(figure):
            assert "nan" not in svg.lower(), figure.key


def test_a_run_of_one_episode_makes_a_whole_report(odd_runs, tmp_path):
    assert report(ReportConfig(runs=[f"one={odd_runs / 'one'}"], out=tmp_path, resamples=100)) == 0
    assert "one episode: no interval" in (tmp_path / "report.md").read_text()
    assert "NaN" not in (tmp_path / "report.json").read_text()


def test_a_log_puts_no_script_into_the_page_and_no_file_elsewhere(tmp_path):
    hostile = '"><img src=x onerror=alert(1)>/../../../escaped'
    write_run(tmp_path / "logs", range(2), initial_conditions=hostile, label=hostile, outcome=hostile, env_id=hostile)
    (tmp_path / "logs" / f"episode_{hostile[:20]}.parquet").write_bytes(b"PAR1")
    out = tmp_path / "in" / "out"
    assert report(ReportConfig(runs=[f"A={tmp_path / 'logs'}"], out=out, resamples=100)) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in", "logs"]
    assert [path.name for path in (tmp_path / "in").iterdir()] == ["out"]
    found = []

    class Attributes(HTMLParser):
        def handle_starttag(self, tag, attributes):
            found.extend((tag, name) for name, _ in attributes if name.startswith("on") or tag in ("img", "script"))

    Attributes().feed((out / "index.html").read_text())
    assert found == []


def test_starts_that_do_not_match_get_no_paired_test(tmp_path):
    write_run(tmp_path / "a", range(0, 6))
    write_run(tmp_path / "b", range(3, 9), jitter=1.0)
    table = matched_table(load_study(ReportConfig(runs=[f"A={tmp_path / 'a'}", f"B={tmp_path / 'b'}"])))
    assert not table.rows
    assert "no paired test" in table.notes[0]
    assert "3 of 6 episodes of A" in table.notes[0]


def test_a_paired_test_that_is_not_defined_says_why_below_its_table(tmp_path):
    for name, jitter in (("a", 1.0), ("b", 2.0)):
        write_run(tmp_path / name, range(4), jitter=jitter, steps=1)
    table = matched_table(load_study(ReportConfig(runs=[f"A={tmp_path / 'a'}", f"B={tmp_path / 'b'}"])))
    (undefined,) = [cells for cells in table.rows if "‖Δa‖ (Eq. 4) (N, N·m mixed)" in cells]
    assert undefined[table.head.index("p")].text == "–"
    assert "A − B, same, ‖Δa‖ (Eq. 4) (N, N·m mixed): no pair." in table.notes
    assert "Holm: over all tests of this table." in table.notes


def test_training_seeds_are_pooled_and_their_spread_is_over_seeds(tmp_path):
    for k in range(3):
        write_run(tmp_path / f"s{k}", range(4), jitter=1.0 + k)
    word = "ACT=" + ",".join(str(tmp_path / f"s{k}") for k in range(3))
    study = load_study(ReportConfig(runs=[word]))
    (r,) = seeds_table(study).rows
    episodes = study.runs[0].sets["same"]
    means = [episodes.columns["smoothness"][episodes.folder == k].mean() for k in range(3)]
    smooth = r[seeds_table(study).head.index("‖Δa‖ (Eq. 4) (N, N·m mixed)")].value
    assert study.runs[0].sets["same"].training_seeds == 3
    assert "as if they were independent" in " ".join(pairs_table(study).notes + at_a_glance(study).notes)
    assert r[-1].text.count(" / ") == 2, "the docked share of each seed"
    half = stats.t.ppf(0.975, 2) * np.std(means, ddof=1) / np.sqrt(3)
    assert (smooth["low"], smooth["high"]) == pytest.approx((np.mean(means) - half, np.mean(means) + half))


def test_folders_of_different_starts_are_no_training_seeds(tmp_path):
    write_run(tmp_path / "a", range(2))
    write_run(tmp_path / "b", range(2), initial_conditions="random")
    study = load_study(ReportConfig(runs=[f"ACT={tmp_path / 'a'},{tmp_path / 'b'}"]))
    assert seeds_table(study) is None
    assert study.pooled() == ()
    assert "training seeds" not in render_page(study, "t", [], [])


def test_two_evaluations_in_one_folder_are_not_one_run(tmp_path):
    write_run(tmp_path / "act", range(2))
    write_run(tmp_path / "mpc", range(2))
    with pytest.raises(InputError, match="twice in one folder"):
        load_study(ReportConfig(runs=[f"ACT={tmp_path}"]))


@pytest.mark.parametrize(
    ("labels", "reference"),
    [(["ACT from MPC", "MPC"], "MPC"), (["ACT", "mpc, free time"], "mpc, free time"), (["ACT from MPC"], None)],
)
def test_the_reference_is_the_run_that_is_called_mpc(tmp_path, labels, reference):
    for i in range(len(labels)):
        write_run(tmp_path / str(i), range(2))
    words = [f"{label}={tmp_path / str(i)}" for i, label in enumerate(labels)]
    assert load_study(ReportConfig(runs=words)).reference == reference


@pytest.mark.parametrize(
    ("runs", "message"),
    [
        ([], "at least once"),
        (["logs/act"], "label="),
        (["=x"], "label="),
        (["A={0}/missing"], "exists"),
        (["A={0}/act", "A={0}/rl"], "twice"),
        (["A={0}/act", "B={0}/act"], "each folder once"),
        (["A={0}/act,{0}/act"], "each folder once"),
        (["A={0}/demos"], "episode_"),
    ],
)
def test_mistakes_in_runs_are_named(logs, runs, message):
    words = [word.format(logs) for word in runs]
    with pytest.raises(InputError, match=message):
        load_study(ReportConfig(runs=words))


def test_mistakes_elsewhere_are_named(logs, tmp_path):
    runs = [f"A={logs / 'act'}"]
    with pytest.raises(InputError, match="--reference"):
        load_study(ReportConfig(runs=runs, reference="MPC"))
    with pytest.raises(InputError, match="--training"):
        load_study(ReportConfig(runs=runs, training=[f"B={logs / 'expert.json'}"]))
    for nothing in ("{}", '{"interactions": Infinity}', '{"interactions": -1}', '{"interactions": "many"}'):
        (tmp_path / "empty.json").write_text(nothing)
        with pytest.raises(FileFormatError, match="interactions"):
            load_study(ReportConfig(runs=runs, training=[f"A={tmp_path / 'empty.json'}"]))
    with pytest.raises(InputError, match=r"--out: .*expert\.json.*Not a directory"):
        report(ReportConfig(runs=[f"A={tmp_path / 'never read'}"], out=logs / "expert.json" / "report"))
    with pytest.raises(InputError, match="--resamples"):
        load_study(ReportConfig(runs=runs, resamples=3))
    with pytest.raises(InputError, match="--workers"):
        load_study(ReportConfig(runs=runs, workers=0))


def test_a_training_folder_of_several_evaluations_is_not_mixed(tmp_path):
    write_run(tmp_path / "evaluation_0001", range(2))
    assert len(log_files(tmp_path)) == 2
    write_run(tmp_path / "evaluation_0002", range(2))
    with pytest.raises(InputError, match="evaluation_0002"):
        log_files(tmp_path)


def test_run_words_take_several_folders(logs):
    (spec,) = parse_runs([f"ACT={logs / 'act'}, {logs / 'rl'}"])
    assert [folder.name for folder in spec.folders] == ["act", "rl"]


def test_numbers_are_shown_without_hiding_them():
    assert number(0.00004).text == "4.0e−05"
    assert number(-4.5e-18).text == "0.000", "rounding"
    assert number(-1234.5678, 1).text == "−1,234.6"
    assert number(None).text == "–"
    assert p_value(0.0).text == "< 1e−300"
    assert p_value(3e-9).text == "3.0e−09"
    assert [percent(*count) for count in ((100, 100), (996, 1000), (2999, 3000), (1, 3000), (0, 5))] == [
        "100", "99.6", "> 99.9", "< 0.1", "0",
    ]  # fmt: skip


def test_tables_escape_what_their_format_reserves():
    table = Table("t", "50 % & more", ("a_b", "x|y"), (("A & B", Cell("1 % ‖r‖", 1)),))
    assert r"A \& B" in to_latex(table)
    assert r"$\|$r$\|$" in to_latex(table)
    assert r"x\|y" in to_markdown(table)
    with pytest.raises(ValueError, match="row of 1 cells"):
        Table("t", "t", ("a", "b"), (("only",),))
