"""The page in a real browser: Chromium, headless."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import Select

from tests.report.conftest import HOSTILE

pytestmark = pytest.mark.slow


def find_browser() -> tuple[str, str]:
    """Chromium, or Chrome, and its driver."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    driver = shutil.which("chromedriver")
    if not browser or not driver:
        pytest.skip("no chromium and chromedriver: on Debian, `make browser` as root installs them")
    return browser, driver


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[webdriver.Chrome]:
    browser, driver = find_browser()
    options = webdriver.ChromeOptions()
    options.binary_location = browser
    plain = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu")
    for argument in (*plain, f"--user-data-dir={tmp_path_factory.mktemp('chromium')}"):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    try:
        session = webdriver.Chrome(options=options, service=Service(driver))
    except (WebDriverException, OSError) as error:
        pytest.skip(f"chromium does not start here: {str(error).splitlines()[0]}")
    yield session
    session.quit()


@pytest.fixture
def page(chromium: webdriver.Chrome, html_page: Path) -> webdriver.Chrome:
    chromium.get(html_page.as_uri())
    return chromium


def complaints(browser: webdriver.Chrome) -> list[str]:
    """What the browser logged of the pages opened here, not of its own, which may load slowly."""
    log = browser.get_log("browser")  # type: ignore[no-untyped-call]
    return [entry["message"] for entry in log if not entry["message"].startswith("chrome://")]


def shown(page: webdriver.Chrome) -> list[WebElement]:
    return [e for e in page.find_elements(By.CSS_SELECTOR, ".pair") if e.is_displayed()]


def choose(page: webdriver.Chrome, name: str, value: str) -> None:
    select = Select(page.find_element(By.CSS_SELECTOR, f'[data-filter="{name}"]'))
    values = [option.get_attribute("value") for option in select.options]
    select.select_by_index(values.index(value))


def ask(page: webdriver.Chrome, script: str, *arguments: Any) -> Any:
    return page.execute_script(f"return {script}", *arguments)


def test_it_loads_without_an_error_or_a_request(page: webdriver.Chrome) -> None:
    assert complaints(page) == []
    assert "2 methods" in page.title
    fetched = ask(page, "performance.getEntriesByType('resource').map(e => e.name)")
    assert [name for name in fetched if not name.startswith("data:")] == []
    pictures = shown(page)[0].find_elements(By.TAG_NAME, "img")
    assert len(pictures) == 5
    page.execute_async_script(
        "Promise.all([...arguments[0].querySelectorAll('img')].map(i => i.decode()))"
        ".then(arguments[1])",
        shown(page)[0],
    )
    assert all(ask(page, "arguments[0].naturalWidth", picture) > 0 for picture in pictures)


def test_the_filters_filter(page: webdriver.Chrome) -> None:
    count = page.find_element(By.ID, "count")
    assert count.text == "18 pairs"
    choose(page, "exposure", "2")
    assert count.text == "6 pairs"
    names = [pair.find_element(By.TAG_NAME, "h3").text for pair in shown(page)]
    assert len(names) == 6
    assert all("exposure2" in name for name in names)
    choose(page, "view", "5")
    assert count.text == "3 pairs"
    choose(page, "method", HOSTILE)
    assert len(shown(page)) == 3
    assert all(HOSTILE in pair.text for pair in shown(page))
    for name in ("method", "exposure", "view"):
        choose(page, name, "")
    assert count.text == "24 of 36 pairs"
    page.find_element(By.ID, "more").click()
    assert count.text == "36 pairs"
    assert not page.find_element(By.ID, "more").is_displayed()


def test_pairs_stand_worst_first_and_a_name_runs_no_script(page: webdriver.Chrome) -> None:
    assert ask(page, "document.querySelectorAll('img[onerror], img[src=x]').length") == 0
    assert HOSTILE in page.find_element(By.TAG_NAME, "table").text
    choose(page, "method", "")
    scores = [float(p.find_element(By.CSS_SELECTOR, ".scores b").text) for p in shown(page)]
    assert (len(scores), scores) == (24, sorted(scores, reverse=True))


def test_the_slider_moves_by_keyboard_and_by_mouse(page: webdriver.Chrome) -> None:
    pair = shown(page)[0]
    slider = pair.find_element(By.CSS_SELECTOR, ".slider")
    prediction = pair.find_element(By.CSS_SELECTOR, ".prediction")
    before = prediction.value_of_css_property("clip-path")
    for _ in range(10):
        slider.send_keys(Keys.ARROW_RIGHT)
    after = prediction.value_of_css_property("clip-path")
    assert "50%" in before
    assert "60%" in after
    webdriver.ActionChains(page).move_to_element_with_offset(slider, -60, 0).click().perform()
    assert prediction.value_of_css_property("clip-path") not in (before, after)


def test_the_error_map_is_switched_by_keyboard(page: webdriver.Chrome) -> None:
    pair = shown(page)[0]
    error = pair.find_element(By.CSS_SELECTOR, ".error")
    button = pair.find_element(By.CSS_SELECTOR, ".toggle")
    assert not error.is_displayed()
    button.send_keys(Keys.SPACE)
    assert error.is_displayed()
    assert button.get_attribute("aria-pressed") == "true"
    button.send_keys(Keys.SPACE)
    assert not error.is_displayed()
    Select(page.find_element(By.ID, "view")).select_by_value("error")
    assert all(p.find_element(By.CSS_SELECTOR, ".error").is_displayed() for p in shown(page))


def test_a_phone_scrolls_no_page_sideways(page: webdriver.Chrome) -> None:
    size = {"width": 390, "height": 800, "deviceScaleFactor": 2, "mobile": True}
    page.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    width = ask(page, "document.documentElement.scrollWidth")
    page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert width <= 390
