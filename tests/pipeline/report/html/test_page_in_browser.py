"""The page in a real browser: a silent console, no request, every control does what it says, axe finds nothing."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from wiclosure.pipeline.report.html import Arm, write_comparison_report, write_run_report
from wiclosure.pipeline.stages.run_result import RunResult

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.slow
Runs = Callable[..., RunResult]
Open = Callable[..., "Page"]

NASTY = "</script><b>'\"&"
NO_WEBGL = """
const get = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...more) {
  return kind.startsWith("webgl") ? null : get.call(this, kind, ...more);
};
"""
DRAWING = ("GPU stall due to ReadPixels", "Automatic fallback to software WebGL")  # of screenshots, of no graphics card


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    sync = pytest.importorskip("playwright.sync_api", reason="playwright is not installed: pip install wiclosure[dev]")
    chromium = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if chromium is None:
        (pytest.fail if os.environ.get("CI") else pytest.skip)("there is no chromium; make browser installs it")
    flags = ["--no-sandbox", "--disable-background-networking", "--disable-component-update", "--no-first-run"]
    with sync.sync_playwright() as playwright:
        found = playwright.chromium.launch(executable_path=chromium, args=flags)
        yield found
        found.close()


@pytest.fixture
def opened(browser: Browser) -> Iterator[Open]:
    """Opens a page; fails at the end where it logged anything or asked for anything."""
    said: list[str] = []
    contexts = []

    def open_page(path: Path, width: int = 1200, **context: object) -> Page:
        contexts.append(browser.new_context(viewport={"width": width, "height": 900}, **context))  # type: ignore[arg-type]
        page = contexts[-1].new_page()
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: said.append(request.url) if request.url != path.as_uri() else None)
        page.goto(path.as_uri())
        page.wait_for_selector("html[data-ready=true]")
        page.wait_for_selector(".scene[data-drawn]")
        return page

    yield open_page
    assert [text for text in said if not any(words in text for words in DRAWING)] == []
    for context in contexts:
        context.close()


@pytest.fixture(scope="module")
def run_page(lost_run: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    write_run_report(folder, lost_run)
    return folder / "report.html"


@pytest.fixture(scope="module")
def comparison_page(run_of: Runs, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("comparison")
    arms = []
    for name, closures in (("none", 8), ("wiclosure", 4)):
        (folder / name).mkdir()
        write_run_report(folder / name, run_of(closures=closures))
        arms.append(Arm(name, folder / name))
    table = {"caption": "All runs", "header": ["report"], "rows": [[{"text": "none", "link": "none/report.html"}]]}
    verdict = {"tone": "good", "sentence": "Quicker.", "next": [], "notes": []}
    write_comparison_report(
        folder, {"of": "comparison", "verdict": verdict, "tables": [table], "look_at": "wiclosure"}, arms
    )
    return folder / "report.html"


def drawn(page: Page) -> int:
    return int(page.get_attribute(".scene", "data-drawn") or 0)


def drawn_again(page: Page, before: int) -> bool:
    page.wait_for_function("before => Number(document.querySelector('.scene').dataset.drawn) > before", arg=before)
    return True


@pytest.mark.parametrize("width", [360, 800, 1600])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_serious_for_screen_readers_and_no_sideways_scrolling(
    opened: Open, run_page: Path, width: int, scheme: str
) -> None:
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="pip install wiclosure[dev]")
    page = opened(run_page, width, color_scheme=scheme)
    found = axe.Axe().run(page).response["violations"]
    assert [(v["id"], v["nodes"][0]["html"]) for v in found if v["impact"] in {"serious", "critical"}] == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_every_toggle_changes_the_picture(opened: Open, run_page: Path) -> None:
    page = opened(run_page)
    boxes = page.locator("#map input")
    labels = [text.strip() for text in page.locator("#map .toggle").all_inner_texts()]
    expected = {"map", "paths", "keyframes", "accepted closures", "rejected closures", "radio links", "ground truth"}
    assert expected | {
        "alpha",
        "beta",
        "gamma (not connected)",
        "robot",
        "height",
        "intensity",
        "after merging",
    } <= set(labels)
    for n in range(boxes.count()):
        box = boxes.nth(n)
        if box.is_disabled():  # before merging there is nothing but odometry
            page.get_by_label("after merging").check()
        if box.get_attribute("type") == "radio" and box.is_checked():
            continue
        picture, before = page.locator(".scene canvas").screenshot(), drawn(page)
        box.click()
        assert drawn_again(page, before)
        label = box.evaluate("box => box.parentElement.textContent")
        assert page.locator(".scene canvas").screenshot() != picture, label
        if box.get_attribute("type") == "checkbox":
            box.click()


def test_keys_turn_and_zoom_the_map(opened: Open, run_page: Path) -> None:
    page = opened(run_page)
    page.focus(".scene canvas")
    for key in ("ArrowLeft", "ArrowUp", "+", "-"):
        before = drawn(page)
        page.keyboard.press(key)
        assert drawn_again(page, before)
    for name in ("from above", "slanted"):
        before = drawn(page)
        page.get_by_role("button", name=name).click()
        assert drawn_again(page, before)


def test_a_reason_leads_to_its_closures_and_they_to_both_scans(
    opened: Open, run_page: Path, lost_run: RunResult
) -> None:
    page = opened(run_page)
    reason = page.locator("#funnel button", has_text="inconsistent with the")
    reason.focus()
    page.keyboard.press("Enter")
    rejected = page.locator("#closures tbody tr")
    assert rejected.count() == sum(c.reason.startswith("inconsistent") for c in lost_run.solution.closures)
    assert page.evaluate("document.activeElement.classList.contains('closure')")
    page.keyboard.press("Enter")
    dialog = page.get_by_role("dialog")
    dialog.wait_for()
    assert "rejected: inconsistent with the" in dialog.inner_text()
    assert dialog.locator("canvas").count() == 1
    both = dialog.locator("canvas").screenshot()
    dialog.locator("input").first.uncheck()
    assert dialog.locator("canvas").screenshot() != both
    title = dialog.locator("h2").inner_text()
    dialog.get_by_role("button", name="next").click()
    page.wait_for_function("title => document.querySelector('dialog h2').textContent !== title", arg=title)
    page.keyboard.press("Escape")
    assert not dialog.is_visible()
    assert page.evaluate("document.activeElement.classList.contains('closure')")  # focus is back where it was


def test_a_click_on_a_closure_in_the_map_opens_it(opened: Open, run_page: Path) -> None:
    page = opened(run_page)
    page.get_by_role("button", name="from above").click()
    page.evaluate("document.querySelector('.scene').scrollIntoView({ block: 'center', behavior: 'instant' })")
    box = page.locator(".scene canvas").bounding_box()
    assert box is not None
    for step in range(2_500):  # a grid over the picture: where closures are drawn is the camera's affair
        x, y = box["x"] + 8 + 16 * (step % 70), box["y"] + 8 + 16 * (step // 70)
        if y > box["y"] + box["height"] - 4:
            break
        page.mouse.move(x, y)
        if page.locator(".hint").inner_text().count("accepted"):
            page.mouse.click(x, y)
            page.get_by_role("dialog").wait_for()
            return
    pytest.fail("no closure was found under the pointer")


def test_the_closures_shown_are_chosen_by_kind(opened: Open, run_page: Path, lost_run: RunResult) -> None:
    page = opened(run_page)
    for kind in ("accepted", "rejected"):
        page.select_option("#which-closures", kind)
        wanted = sum((c.rejected_at is None) == (kind == "accepted") for c in lost_run.solution.closures)
        assert page.locator("#closures tbody tr").count() == wanted


def test_matrix_and_links_also_as_tables(opened: Open, run_page: Path) -> None:
    page = opened(run_page)
    before = page.locator("canvas.matrix").screenshot()
    page.get_by_label("metres travelled").check()
    assert page.locator("canvas.matrix").screenshot() != before
    page.get_by_text("The same as a table").click()
    page.locator("#candidates tbody tr").first.wait_for()  # built when it is opened
    assert page.locator("#candidates tbody tr").count() == 10
    page.locator("#radio select").select_option("1")
    page.get_by_text("The alignment is not certain").wait_for()
    assert "4.0 to 1" in page.locator("#radio").inner_text()
    page.get_by_text("30 measurements as a table").click()
    page.locator("#radio details tbody tr").first.wait_for()
    assert page.locator("#radio details tbody tr").count() == 30
    assert page.locator("#radio .u-wrap").count() == 3


def test_arms_are_looked_at_one_by_one(opened: Open, comparison_page: Path) -> None:
    page = opened(comparison_page)
    assert "Quicker." in page.locator("main > .verdict").inner_text()
    assert page.get_by_role("link", name="none").get_attribute("href") == "none/report.html"
    assert "joined by 4 closures" in page.locator("#run").inner_text()
    page.get_by_label("none", exact=True).check()
    page.locator("#run", has_text="joined by 8 closures").wait_for()
    assert page.locator(".scene").count() == 1


def test_colours_follow_the_choice_and_print_is_light(opened: Open, run_page: Path) -> None:
    page = opened(run_page, color_scheme="dark")
    background = "getComputedStyle(document.body).backgroundColor"
    assert page.evaluate(background) == "rgb(20, 24, 28)"
    page.locator("header select").select_option("light")
    assert page.evaluate(background) == "rgb(255, 255, 255)"
    page.locator("header select").select_option("")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(background) == "rgb(255, 255, 255)"
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(background) == "rgb(20, 24, 28)"
    page.emulate_media(media="print")
    assert not page.locator("nav").is_visible()
    page.set_viewport_size({"width": 700, "height": 900})  # about a page's width
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_who_wants_no_motion_gets_none(opened: Open, run_page: Path) -> None:
    behaviour = "getComputedStyle(document.documentElement).scrollBehavior"
    assert opened(run_page, reduced_motion="reduce").evaluate(behaviour) == "auto"
    assert opened(run_page, reduced_motion="no-preference").evaluate(behaviour) == "smooth"


def test_names_from_recordings_are_shown_as_they_are(opened: Open, run_of: Runs, tmp_path: Path) -> None:
    write_run_report(tmp_path, run_of((NASTY, "机器人\n2")))
    page = opened(tmp_path / "report.html")
    assert NASTY in page.locator("h1").inner_text()
    assert page.locator("#map .toggle", has_text=NASTY).count() == 1
    assert page.locator("main b").count() == 0


@pytest.mark.parametrize("robots", [("alone",), ("alpha", "beta")])
def test_a_run_with_nothing_in_it(opened: Open, run_of: Runs, tmp_path: Path, robots: tuple[str, ...]) -> None:
    write_run_report(tmp_path, run_of(robots, closures=0, measurements=0, map_points=0))
    page = opened(tmp_path / "report.html")
    assert page.locator(".verdict").count() == 1
    assert page.locator("#closures").count() == 0


def test_without_webgl_the_rest_is_there(browser: Browser, run_page: Path) -> None:
    page = browser.new_page()
    page.add_init_script(NO_WEBGL)
    page.goto(run_page.as_uri())
    page.wait_for_selector("html[data-ready=true]")
    assert "draws no WebGL" in page.locator("#map").inner_text()
    page.locator("#closures tbody button").first.click()
    page.get_by_role("dialog").wait_for()
    page.close()
