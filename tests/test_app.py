"""The page to click: what it runs, what it gives along, and all of it in a browser."""

import re
import shutil
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import numpy as np
import pytest
from click.testing import CliRunner

from romsindy import Identification
from romsindy.commands.main import main
from romsindy_app import command
from romsindy_app.picking import draw, picked
from romsindy_app.session import Choice, Session

PATIENCE = 240  # s, on a machine that does other things


def record(releases=1):
    """Linear decays of 40 cycles in closed form, 50 dB, as CSV in mm."""
    t = np.arange(0, 6 * releases, 1 / 120)
    x = 12 * np.exp(-0.3 * (t % 6)) * np.cos(40 * (t % 6))
    x += 0.03 * np.random.default_rng(0).normal(size=len(t))
    lines = [f"{a:.6f},{b:.6f}" for a, b in zip(t, x, strict=True)]
    return "\n".join(["t [s],x [mm]", *lines]).encode()


@pytest.mark.parametrize(
    ("name", "kept"),
    [
        ("a.csv", "a.csv"),
        ("../../etc/x.csv", "x.csv"),
        ("C:\\a\\b.csv", "b.csv"),
        ("-o.csv", "o.csv"),
    ],
)
def test_what_is_dropped_stays_in_the_folder(name, kept):
    session = Session()
    path = session.put(name, b"x")
    assert path == session.folder / kept and path.read_bytes() == b"x"


def test_a_second_file_of_one_name_replaces_nothing():
    session = Session()
    first, second, again = (session.put("a.csv", x) for x in (b"x", b"y", b"y"))
    assert (first.name, second.name, again.name) == ("a.csv", "a_2.csv", "a_2.csv")
    assert first.read_bytes() == b"x" and second.read_bytes() == b"y"


def test_a_file_is_looked_at_by_the_command():
    session = Session()
    seen, said, page = session.inspect(session.put("a.csv", record()), Choice())
    assert seen["modes"][0]["frequency"]["loud"] == pytest.approx(40 / (2 * np.pi), rel=1e-3)
    assert said.startswith("a.csv: 720 samples") and page.read_text().count("data:image/png") == 1
    none, why, page = session.inspect(session.put("b.csv", b"hello\n"), Choice(unit="mm"))
    assert none is None and page is None and "b.csv" in why
    assert session.commands[1].startswith("romsindy inspect b.csv --unit mm")


TWO_MODES = {
    "start": 0.0,
    "end": 10.0,
    "releases": [{"start": 0.0, "end": 5.0}, {"start": 5.0, "end": 10.0}],
    "modes": [
        {
            "number": number,
            "along": [
                {
                    "release": r,
                    "t": [5 * r - 4, 5 * r - 2],
                    "frequency": [f, f],
                    "amplitude": [2, 1],
                }
                for r in (1, 2)
            ],
        }
        for number, f in ((1, 8.0), (2, 30.0))
    ],
}


@pytest.mark.parametrize(
    ("box", "meant"),
    [
        ((0, 4, 20, 40), (2, 1)),  # times, then frequencies
        ((4, 10, 0, 10), (1, 2)),
        ((0, 10, 20, 40), (2, None)),
        ((0, 10, 10, 20), (None, None)),
        ((0, 4, 0, 40), (1, 1)),
        ((2, 10, 8, 30), (1, None)),
    ],
)
def test_what_a_box_holds_is_meant(box, meant):
    """Most points decide on the mode, the first of equals; one release, or all that are touched."""
    t0, t1, f0, f1 = box
    assert picked(TWO_MODES, lambda t, f: (t >= t0) & (t <= t1) & (f >= f0) & (f <= f1)) == meant


def test_what_can_be_picked_is_drawn_within_its_axes():
    ax = draw(TWO_MODES)
    for dots in ax.collections:
        x, y = dots.get_offsets().T
        low, high = ax.get_ylim()
        assert np.all((x >= 0) & (x <= 10) & (y > low) & (y < high))
    assert len(ax.collections) == 4 and len(ax.lines) == 1  # one more release begins


def test_channels_are_named_where_the_file_can_be_read():
    session = Session()
    lines = ["t [s],tip [mm],base [mm]", *(f"{i},{i % 5},{i % 7}" for i in range(99))]
    table = "\n".join(lines).encode()
    assert session.channels(session.put("a.csv", table), "") == ("tip", "base")
    assert session.channels(session.put("b.csv", b"hello\n"), "") == ()


def ended(job):
    until = time.monotonic() + PATIENCE
    while job.running and time.monotonic() < until:
        time.sleep(0.2)
    assert job.said is not None
    return job


@pytest.mark.study
@pytest.mark.slow
def test_what_it_gives_along_does_the_same():
    """The script of the page, and its command, give the equation that was shown."""
    session = Session()
    path, choice = session.put("a.csv", record()), Choice(mode=1, release=1)
    job = ended(session.identify(path, choice))
    assert "The model explains the data" in job.said and not job.refused and not job.stopped
    files = job.files()
    assert set(files) == {"page", "model", "all that was found"}
    (session.folder / "script.py").write_text(session.script(path, choice))
    shown = Identification.load(files["all that was found"]).model
    done = [sys.executable, "script.py"]
    subprocess.run(done, cwd=session.folder, check=True, capture_output=True)
    assert Identification.load(session.folder / "found.json").model == shown
    job = ended(session.diagnose(path, choice, "--model", files["model"]))
    assert job.said.startswith("none") and "page" in job.files()


@pytest.mark.slow
@pytest.mark.parametrize("heard", [signal.default_int_handler, signal.SIG_IGN])
@pytest.mark.parametrize("begun", [1.0, 3.0])  # s: while it loads, while it fits
def test_long_work_can_be_stopped(heard, begun):
    """Also where the page was begun in the background: no child hears of Ctrl-C there."""
    session, before = Session(), signal.signal(signal.SIGINT, heard)
    job = session.identify(session.put("a.csv", record(releases=20)), Choice())
    signal.signal(signal.SIGINT, before)
    time.sleep(begun)
    job.stop()
    ended(job)
    assert job.stopped and "interrupted" in job.said.lower()


def test_a_port_that_is_taken_and_a_page_that_is_not_installed(monkeypatch):
    pytest.importorskip("marimo")
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        result = CliRunner().invoke(main, ["app", "--port", str(port), "--no-browser"])
    assert result.exit_code == 2 and f"--port {port} is taken" in result.output
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    result = CliRunner().invoke(main, ["app"])
    assert result.exit_code == 2 and 'pip install "romsindy[app]"' in result.output


# -- in a browser ---------------------------------------------------------------------------------

_FIND = """
const [what, text] = arguments, found = [];
function walk(root) {
  for (const e of root.querySelectorAll("*")) {
    if (e.matches(what) && (!text || e.textContent.includes(text))) found.push(e);
    if (e.shadowRoot) walk(e.shadowRoot);
  }
}
walk(document);
return found;
"""


class Page:
    """A page in a browser, and how often it was clicked."""

    def __init__(self, driver, browser):
        self.driver, self.browser, self.clicks = driver, browser, 0

    def find(self, what, text=None):
        """The first element of a kind with a text, as soon as it is there."""
        until = time.monotonic() + PATIENCE
        while time.monotonic() < until:
            found = self.browser.execute_script(_FIND, what, text)
            if found:
                return found[0]
            time.sleep(0.3)
        raise AssertionError(f"no {what} with {text!r}: {self.browser.page_source[:500]}")

    def shown(self, what, text=None):
        """The same, once it is in the middle of the window."""
        element = self.find(what, text)
        self.browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", element)
        time.sleep(1.0)  # it scrolls smoothly
        return element

    def click(self, what, text):
        self.shown(what, text).click()
        self.clicks += 1

    def drag(self, what, start, end):
        """From one place of an element to another, as parts of its width and height."""
        element = self.shown(what)
        size = np.array([element.size["width"], element.size["height"]])
        (x, y), (dx, dy) = (size * (np.array(start) - 0.5), size * np.subtract(end, start))
        hand = self.driver.ActionChains(self.browser)
        hand.move_to_element_with_offset(element, x, y).click_and_hold().move_by_offset(dx, dy)
        hand.release().perform()


@pytest.fixture
def page(tmp_path):
    pytest.importorskip("marimo")
    webdriver = pytest.importorskip("selenium.webdriver")
    driver = shutil.which("chromedriver")
    if driver is None:
        pytest.skip("no chromedriver: apt install chromium chromium-driver")
    words = [sys.executable, "-u", "-m", "romsindy", "app", "--no-browser"]
    server = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    address = re.search(r"http\S+", server.stdout.readline())[0]
    options = webdriver.ChromeOptions()
    for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=1280,1400"):
        options.add_argument(word)
    options.add_experimental_option("prefs", {"download.default_directory": str(tmp_path)})
    browser = webdriver.Chrome(options, webdriver.ChromeService(driver))
    try:
        with pytest.raises(urllib.error.HTTPError, match="401"):  # without the token
            urllib.request.urlopen(address.partition("?")[0] + "/api/status")
        browser.get(address)
        yield Page(webdriver, browser)
    finally:
        browser.quit()
        server.terminate()
        server.communicate()


@pytest.mark.slow
def test_a_file_is_dropped_identified_and_its_report_downloaded(page, tmp_path):
    """At most five clicks."""
    (tmp_path / "a.csv").write_bytes(record())
    page.find("input[type=file]").send_keys(str(tmp_path / "a.csv"))
    page.click("button", "Identify")
    page.find("pre", "The model explains the data")
    page.click("a", "Download page")
    report = tmp_path / "a_report.html"
    until = time.monotonic() + PATIENCE
    while not report.is_file() and time.monotonic() < until:
        time.sleep(0.3)
    assert 'content="romsindy identify"' in report.read_text() and page.clicks <= 5


@pytest.mark.study
@pytest.mark.slow
def test_a_mode_is_picked_with_the_pointer(page, tmp_path):
    """A box around the upper of two modes chooses it below, and is what is identified."""
    t = np.arange(0, 6, 1 / 300)
    x = 12 * np.exp(-0.3 * t) * np.cos(40 * t) + 4 * np.exp(-0.5 * t) * np.cos(190 * t)
    x += 0.03 * np.random.default_rng(0).normal(size=len(t))
    table = "\n".join(["t [s],x [mm]", *(f"{a:.6f},{b:.6f}" for a, b in zip(t, x, strict=True))])
    (tmp_path / "two.csv").write_text(table)
    page.find("input[type=file]").send_keys(str(tmp_path / "two.csv"))
    page.drag("canvas", (0.12, 0.17), (0.9, 0.5))  # within the axes
    page.find("option:checked", "2: 30.2")
    page.find("option:checked", "1: 0 to")
    page.click("button", "Identify")
    page.find("pre", "Used: mode 2")
