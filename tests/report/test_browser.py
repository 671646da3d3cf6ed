"""The page in a real browser: nothing broken, nothing wider than the screen, both colour schemes."""

import re
import shutil
import subprocess

import pytest
from synthetic_logs import write_run

from lerobot_spacedock.report.build import ReportConfig, report

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium here")

PROBE = """<script>addEventListener('load', () => {
  const wide = [...document.querySelectorAll('body *')].filter(e => !e.closest('.scroll, nav, svg')
    && e.getBoundingClientRect().right > innerWidth + 1).map(e => e.tagName + '#' + e.id);
  const blank = [...document.querySelectorAll('svg')].filter(s => s.getBoundingClientRect().height < 50).length;
  const broken = [...document.images].filter(i => !i.naturalWidth).length;
  const style = getComputedStyle(document.body);
  const axis = getComputedStyle(document.querySelector('svg text')).fill;
  document.body.innerHTML = 'PROBE ' + JSON.stringify({width: innerWidth,
    scroll: document.documentElement.scrollWidth, wide, blank, broken, ground: style.backgroundColor,
    ink: style.color, axis, svgs: document.querySelectorAll('svg').length}) + ' END';
});</script>"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("browser")
    for name, jitter in (("a_very_long_label_for_a_run_of_act", 1.0), ("RL", 4.0)):
        write_run(folder / name, range(4), jitter=jitter)
    runs = [f"{path.name}={path}" for path in sorted(folder.iterdir())]
    assert report(ReportConfig(runs=runs, out=folder / "out", resamples=100)) == 0
    text = (folder / "out" / "index.html").read_text()
    probe = folder / "probe.html"
    probe.write_text(text.replace("</body>", PROBE + "</body>"))
    return probe


def probe(page, width, *, dark=False):
    command = [BROWSER, "--headless=new", "--no-sandbox", "--disable-gpu", f"--window-size={width},900"]
    command += [f"--blink-settings=preferredColorScheme={0 if dark else 1}", "--virtual-time-budget=4000"]
    command += [f"--user-data-dir={page.parent / f'profile-{width}-{dark}'}", "--dump-dom", page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    found = re.search(r"PROBE (\{.*\}) END", done.stdout)
    assert found, done.stderr[-2000:]
    import json

    return json.loads(found.group(1))


@pytest.mark.parametrize("width", [1280, 500])
def test_nothing_is_broken_or_wider_than_the_screen(page, width):
    seen = probe(page, width)
    assert seen["width"] == width
    assert seen["scroll"] <= width
    assert seen["wide"] == []
    assert (seen["blank"], seen["broken"]) == (0, 0)
    assert seen["svgs"] > 20


def test_light_and_dark_change_the_ground_and_the_figures_ink(page):
    def brightness(colour):
        return sum(map(float, re.findall(r"[\d.]+", colour)[:3]))

    light, dark = probe(page, 1280), probe(page, 1280, dark=True)
    assert brightness(light["ground"]) > 700 > 100 > brightness(dark["ground"])
    assert brightness(light["axis"]) < 150
    assert brightness(dark["axis"]) > 600
