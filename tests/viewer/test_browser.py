"""The page and the film in a Chromium without a screen."""

import os
import re
import shutil
import subprocess
import sys
import time

import pytest

from archerfish.cli.main import main

pytest.importorskip("viser", reason="needs viser, the extra view")
pytest.importorskip("selenium", reason="needs selenium, the extra dev")
FLAGS = (
    "--headless --no-sandbox --disable-gpu --no-first-run --disable-background-networking --disable-dev-shm-usage "
    "--use-gl=angle --use-angle=swiftshader --enable-unsafe-swiftshader --ignore-gpu-blocklist "
    "--window-size=700,600 --force-device-scale-factor=0.5"  # few pixels, which the processor draws
)
PATIENCE_S = 240.0


@pytest.fixture
def browser(tmp_path):
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    driver = shutil.which("chromedriver")
    if chromium is None or driver is None:
        pytest.skip("needs Chromium and its driver (Debian: chromium chromium-driver)")
    from selenium import webdriver
    from selenium.webdriver.chrome.service import Service

    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS.split(), f"--user-data-dir={tmp_path / 'profile'}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = webdriver.Chrome(options=options, service=Service(driver))
    yield browser
    browser.quit()


@pytest.fixture
def address():
    """Run the command; yield where its page is."""
    command = [sys.executable, "-m", "archerfish", "view", "--port", "0", "--engagements", "3"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "ARCHERFISH_CACHE": "off"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment)
    printed = next(line for line in process.stdout if "http://" in line)
    assert "Ctrl-C ends it" in printed
    yield re.search(r"http://127\.0\.0\.1:\d+", printed)[0]
    process.terminate()
    rest, _ = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, rest) == (143, "")


def until(browser, pattern):
    """Wait until the text of the page has a pattern; return the match."""
    limit = time.monotonic() + PATIENCE_S
    while not (found := re.search(pattern, text := browser.execute_script("return document.body.innerText"))):
        assert time.monotonic() < limit, f"{pattern} did not come; the page says:\n{text}"
        time.sleep(0.1)
    return found


def test_the_page_and_the_film_play_and_ask_nobody_else(browser, address, tmp_path):
    browser.get(address)
    first = until(browser, r"Whole trial: (\d+) of 150 hit")[1]
    press = "[...document.querySelectorAll('button')].find(b => b.innerText.includes('other controller')).click()"
    browser.execute_script(press)
    until(browser, r"kalman-lq − kalman: .* points .*, same engagements")
    browser.execute_script(press)
    assert until(browser, r"Whole trial: (\d+) of 150 hit[^$]*kalman − kalman-lq")[1] == first
    until(browser, r"Engagement 2 of 3 \(parabola, 3.0 m\)\s+\d+ of [1-9]")
    hosts = "return performance.getEntriesByType('resource').map(e => e.name).filter(n => /^(http|ws)/.test(n))"
    assert all(name.startswith(address) for name in browser.execute_script(hosts))
    film = tmp_path / "film.html"
    main(["view", "--engagements", "3", "--export", str(film)])
    browser.get(film.as_uri())
    until(browser, r"Engagement 1 of 3 \(still\), 0\.[3-9]\d s: \d+ of [1-9]")
    browser.execute_script("document.onkeydown({key: 'ArrowDown', target: document.body, preventDefault() {}})")
    until(browser, r"Engagement 2 of 3 \(parabola\)")
    assert browser.execute_script("return document.querySelector('#field canvas').toDataURL().length") > 3000
    for width in (1280, 400):
        metrics = {"width": width, "height": 800, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        assert browser.execute_script("return document.documentElement.scrollWidth - innerWidth") <= 0
    assert browser.execute_script(hosts) == []
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
