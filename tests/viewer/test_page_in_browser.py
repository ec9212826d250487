"""The page in a real Chromium without a screen: clicked, dragged, and read.

ARCHERFISH_SCREENSHOTS=FOLDER has the pictures of README and docs taken anew into that folder.
"""

import json
import math
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("viser", reason="needs viser, the extra view")
pytest.importorskip("selenium", reason="needs selenium, the extra dev")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")
if CHROMIUM is None or DRIVER is None:
    pytest.skip("needs Chromium and its driver (Debian: chromium chromium-driver)", allow_module_level=True)

from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from archerfish.viewer.scene import FIELD_OF_VIEW, VIEWPOINTS

FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --no-first-run --disable-background-networking "
    "--disable-component-update --disable-sync --use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader "
    "--ignore-gpu-blocklist --disable-dev-shm-usage"
)
SMALL = ("--window-size=1000,800", "--force-device-scale-factor=0.5")
"""Few pixels: without a graphics card each one is drawn by the processor."""
PATIENCE_S = 60.0
"""For a busy machine that draws in software; what it really took is printed."""
ENGAGEMENTS = 4


def open_browser(profile: Path, *flags: str, watched: bool = False) -> Any:
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS.split(), *flags, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    # The log of all requests holds every message of the websocket too: minutes to read, after a few tests.
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"} | ({"performance": "ALL"} if watched else {}))
    return webdriver.Chrome(options=options, service=Service(DRIVER))


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    driver = open_browser(tmp_path_factory.mktemp("chromium"), *SMALL)
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A browser of whose requests a log is kept."""
    driver = open_browser(tmp_path_factory.mktemp("watched"), *SMALL, watched=True)
    yield driver
    driver.quit()


def start(*words: str) -> tuple[subprocess.Popen[str], str]:
    """Start the command; return its process and the address that it tells."""
    program = f"from archerfish.cli.main import program; import sys; sys.argv[1:] = {list(words)!r}; program()"
    process = subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    for line in process.stderr:
        if found := re.search(r"http://[\w.:]+", line):
            return process, found[0]
    raise AssertionError("the command ended before it told an address")


def end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    process.communicate(timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    process, told = start("view", "--port", "0", "--engagements", str(ENGAGEMENTS))
    yield told
    end(process)


def text_of(browser: Any) -> str:
    return str(browser.execute_script("return document.body.innerText"))


def until(browser: Any, condition: Callable[[str], bool], what: str) -> str:
    """Wait until the text of the page meets a condition; return it."""
    limit = time.monotonic() + PATIENCE_S
    while time.monotonic() < limit:
        text = text_of(browser)
        if condition(text):
            return text
        time.sleep(0.1)
    raise AssertionError(f"{what} did not come; the page says:\n{text_of(browser)}")


def whole(text: str) -> str:
    """Return how the whole trial ended, which tells one trial from another."""
    found = re.search(r"Whole trial: (\d+ of \d+) hit", text)
    return found[1] if found else ""


@pytest.fixture
def page(browser: Any, address: str) -> Any:
    """The page, ready, with the trial that it begins with."""
    return opened(browser, address)


def opened(browser: Any, address: str) -> Any:
    begun = time.monotonic()
    browser.get(address)
    until(browser, lambda text: bool(whole(text)) and "Speed [m/s]" in text, "the trial")
    print(f"page ready after {time.monotonic() - begun:.1f} s")
    close_notices(browser)
    return browser


def close_notices(browser: Any) -> None:
    for button in browser.find_elements(By.CSS_SELECTOR, ".mantine-Notification-closeButton"):
        browser.execute_script("arguments[0].click()", button)


def control(browser: Any, label: str, kind: str) -> Any:
    """Return the input that follows a label."""
    where = f'//*[normalize-space(.)="{label}"]/following::input[{kind}][1]'
    limit = time.monotonic() + PATIENCE_S
    while not (found := browser.find_elements(By.XPATH, where)) and time.monotonic() < limit:
        time.sleep(0.1)
    return found[0]


def choose(browser: Any, label: str, option: str) -> None:
    found = control(browser, label, '@role="combobox"')
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", found)
    found.click()
    limit = time.monotonic() + PATIENCE_S
    while time.monotonic() < limit:
        options = browser.find_elements(By.CSS_SELECTOR, f'[role=option][value="{option}"]')
        shown = [each for each in options if each.is_displayed()]
        if shown:
            # The list may be longer than its window.
            browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", shown[0])
            shown[0].click()
            return
        time.sleep(0.05)
    raise AssertionError(f"no option {option}")


def enter(browser: Any, label: str, value: float) -> None:
    found = control(browser, label, '@inputmode="decimal"')
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", found)
    found.click()
    found.send_keys(Keys.CONTROL, "a")
    found.send_keys(f"{value}", Keys.ENTER)


def press(browser: Any, label: str) -> None:
    button = browser.find_element(By.XPATH, f'//button[normalize-space(.)="{label}"]')
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", button)
    button.click()


def pause(browser: Any) -> None:
    """Pause the film, unless it came to its end meanwhile."""
    limit = time.monotonic() + PATIENCE_S
    while "Play" not in text_of(browser).split("\n") and time.monotonic() < limit:
        for button in browser.find_elements(By.XPATH, '//button[normalize-space(.)="Pause"]'):
            browser.execute_script("arguments[0].click()", button)
        time.sleep(0.5)


def changed(browser: Any, before: str, line: str) -> str:
    """Wait for another trial than the one before, with a line of its own."""
    return whole(until(browser, lambda text: line in text and whole(text) != before, f"a trial with {line!r}"))


def test_the_same_engagement_is_met_by_the_other_controller_and_again_by_the_first(page: Any) -> None:
    first = whole(text_of(page))
    press(page, "Same engagement, other controller")
    second = changed(page, first, "kalman · parabola")
    assert "same engagements" in until(page, lambda text: "kalman − kalman-lq" in text, "the comparison")
    press(page, "Same engagement, other controller")
    assert changed(page, second, "kalman-lq · parabola") == first


def test_the_film_is_paused_scrubbed_slowed_and_played(page: Any) -> None:
    pause(page)
    enter(page, "Time [s]", 0.8)
    shown = r"Engagement 1 of \d+: \d+ of [123]\d hit"
    found = re.search(shown, until(page, lambda text: bool(re.search(shown, text)), "the middle of the first"))
    assert found is not None
    time.sleep(0.5)
    assert found[0] in text_of(page)
    choose(page, "Pace", "a fifth")
    press(page, "Play")
    until(page, lambda text: found[0] not in text and "Pause" in text.split("\n"), "what comes next")
    choose(page, "Pace", "real time")
    pause(page)
    enter(page, "Time [s]", 4)
    interval = until(page, lambda text: "Engagement 4 of" in text, "the fourth engagement")
    assert re.search(r"So far: [\d.]+ % \([\d.]+–[\d.]+\), \d+ of 150 in 3 engagements", interval)
    press(page, "Play")


def test_the_page_asks_no_other_host_and_has_no_errors(watched: Any, address: str) -> None:
    opened(watched, address)
    assert requests(watched, but=address) == []
    assert errors(watched) == []


def requests(browser: Any, but: str) -> list[str]:
    """Return what was asked of hosts since the last call, but for one address."""
    messages = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    sent = [each["params"]["request"]["url"] for each in messages if each["method"] == "Network.requestWillBeSent"]
    sent += [each["params"]["url"] for each in messages if each["method"] == "Network.webSocketCreated"]
    outward = [url for url in sent if re.match(r"(https?|wss?)://", url)]
    return [url for url in outward if url.partition("://")[2].partition("/")[0] != but.partition("://")[2]]


def errors(browser: Any) -> list[str]:
    return [str(entry["message"]) for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from archerfish.cli.main import main

    path = tmp_path_factory.mktemp("film") / "trial.html"
    main(["view", "--controllers", "parabola-lq", "--engagements", "3", "--export", str(path)])
    return path


def test_an_exported_film_plays_from_a_file_without_a_network(watched: Any, film: Path) -> None:
    watched.get("about:blank")
    watched.get_log("performance")
    watched.get_log("browser")
    watched.get(film.as_uri())
    until(watched, lambda _: bool(watched.find_elements(By.TAG_NAME, "canvas")), "the picture")
    limit, pictures = time.monotonic() + PATIENCE_S, set()
    while len(pictures) < 3 and time.monotonic() < limit:
        pictures.add(watched.find_element(By.TAG_NAME, "canvas").screenshot_as_png)
    assert len(pictures) == 3, "nothing moves"
    assert requests(watched, but="") == []
    assert errors(watched) == []


def test_a_recording_is_played_as_the_angles_that_it_holds(browser: Any, tmp_path: Path) -> None:
    moments = np.arange(300) * 0.01
    rows = [f"{moment:.2f},{0.4 * math.sin(2 * moment):.5f},0.1" for moment in moments]
    # A name is shown as it stands: no picture, nothing in italics.
    name = "log <img src=x> _1_.csv"
    log = tmp_path / name
    log.write_text("\n".join(["time_s,yaw,pitch", *rows]) + "\n")
    process, address = start("view", str(log), "--port", "0")
    try:
        browser.get(address)
        text = until(browser, lambda text: f"{name}, 3.0 s" in text, "the recording")
        assert "no target and no pellets" in text
        enter(browser, "Time [s]", 0.79)
        until(browser, lambda text: "At 0.79 s: pitch +5.73°, yaw +22.9" in text, "the angles")
    finally:
        end(process)


@pytest.mark.skipif(
    "ARCHERFISH_SCREENSHOTS" not in os.environ, reason="takes pictures if ARCHERFISH_SCREENSHOTS is set"
)
def test_screenshots_are_taken(address: str, film: Path, tmp_path: Path) -> None:
    folder = Path(os.environ["ARCHERFISH_SCREENSHOTS"])
    folder.mkdir(parents=True, exist_ok=True)
    large = open_browser(tmp_path, "--window-size=1400,1280")
    try:
        opened(large, address)
        press(large, "Same engagement, other controller")
        until(large, lambda text: "kalman · parabola" in text, "the other controller")
        press(large, "Same engagement, other controller")
        until(large, lambda text: "kalman-lq − kalman" in text, "the comparison")
        enter(large, "Time [s]", 4.72)
        until(large, lambda text: "Engagement 4 of" in text, "the fourth engagement")
        large.execute_script("arguments[0].scrollIntoView(false)", control(large, "Controller", '@role="combobox"'))
        time.sleep(3.0)
        large.save_screenshot(str(folder / "viewer.png"))
        large.set_window_size(1100, 760)
        large.get(film.as_uri())
        time.sleep(10.0)
        close_notices(large)
        time.sleep(2.0)
        large.save_screenshot(str(folder / "viewer_export.png"))
        assert all((folder / name).stat().st_size > 10_000 for name in ("viewer.png", "viewer_export.png"))
    finally:
        large.quit()


def test_controller_motion_distance_and_latency_each_change_the_trial(page: Any) -> None:
    now = whole(text_of(page))
    choose(page, "Controller", "parabola-lq")
    now = changed(page, now, "parabola-lq ·")
    choose(page, "Target", "circle")
    now = changed(page, now, "· circle ·")
    enter(page, "Distance [m]", 5)
    now = changed(page, now, "· 5.0 m ·")
    enter(page, "Speed [m/s]", 1)
    now = changed(page, now, "· 1.00 m/s")
    enter(page, "Added command latency [ms]", 40)
    now = changed(page, now, "parabola-lq ·")
    press(page, "New engagements")
    changed(page, now, "parabola-lq ·")


def pixel(browser: Any, point: tuple[float, float, float], distance: float) -> tuple[float, float]:
    """Project a point of the scene as the first camera sees it."""
    place, towards = (np.array(each) for each in VIEWPOINTS["behind the robot"](distance))
    forward = (towards - place) / np.linalg.norm(towards - place)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up, seen = np.cross(right, forward), np.array(point) - place
    width, height = browser.execute_script("return [window.innerWidth, window.innerHeight]")
    scale = 0.5 * height / math.tan(FIELD_OF_VIEW / 2) / (seen @ forward)
    return width / 2 + scale * (seen @ right), height / 2 - scale * (seen @ up)


def test_the_target_is_dragged_by_hand_and_the_gimbal_follows(page: Any) -> None:
    # Last of all: the page keeps what the test before it chose.
    enter(page, "Speed [m/s]", 1)
    enter(page, "Distance [m]", 3)
    choose(page, "Target", "dragged by hand")
    until(page, lambda text: "Target at 3.00, 0.00, 0.00 m" in text, "the hand")
    page.execute_script("window.scrollTo(0, 0)")
    start_x, start_y = pixel(page, (3.0, 0.3, 0.0), 3.0)
    end_x, end_y = pixel(page, (3.0, 1.0, 0.0), 3.0)
    actions = ActionChains(page, duration=200)
    actions.w3c_actions.pointer_action.move_to_location(round(start_x), round(start_y))
    actions.pause(0.5).click_and_hold()
    for share in np.linspace(0.1, 1.0, 6):
        x, y = (round(float(a + share * (b - a))) for a, b in ((start_x, end_x), (start_y, end_y)))
        actions.w3c_actions.pointer_action.move_to_location(x, y)
    actions.release().perform()

    def lateral(text: str) -> float:
        found = re.search(r"Target at [-\d.]+, ([-\d.]+),", text)
        return float(found[1]) if found else 0.0

    until(page, lambda text: lateral(text) > 0.4, "the dragged target")
    until(page, lambda text: bool(re.search(r"[1-9]\d* of \d+ hit", text)), "a hit")
    until(page, lambda text: bool(re.search(r"in \d+ engagements of 50 shots", text)), "the interval")
