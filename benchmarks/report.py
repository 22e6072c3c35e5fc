"""Size of a large team's report, what writing it takes, and how soon a browser shows it.

Ten robots with 5,000 keyframes each, 300,000 points, 5,000 closures and 20,000 measurements.
Needs chromium and playwright.

    python benchmarks/report.py [--robots 10] [--keyframes 5000] [--repeats 3]
"""

from __future__ import annotations

import argparse
import runpy
import tempfile
import time
import tracemalloc
from pathlib import Path

from wiclosure.pipeline.report.html import write_run_report

TEAM = Path(__file__).resolve().parent.parent / "tests/pipeline/report/conftest.py"
CHROMIUM = "/usr/bin/chromium"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--keyframes", type=int, default=5_000)
    parser.add_argument("--points", type=int, default=300_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--page", type=Path, help="measure how soon this page opens instead")
    arguments = parser.parse_args()
    if arguments.page is not None:
        opening(arguments.page, arguments.repeats)
        return
    made = runpy.run_path(str(TEAM))["made_run"](
        [f"robot{n}" for n in range(arguments.robots)],
        keyframes=arguments.keyframes,
        closures=370,
        measurements=2_200,
        map_points=arguments.points,
    )
    with tempfile.TemporaryDirectory() as folder:
        times = []
        for _ in range(arguments.repeats):
            began = time.perf_counter()
            write_run_report(Path(folder), made)
            times.append(time.perf_counter() - began)
        tracemalloc.start()
        write_run_report(Path(folder), made)
        peak_mb = tracemalloc.get_traced_memory()[1] / 1e6
        page = Path(folder) / "report.html"
        size_mb = page.stat().st_size / 1e6
        print(f"{size_mb:.1f} MB, written in {min(times):.1f} s (least of {times}), {peak_mb:.0f} MB more at the peak")
        opening(page, arguments.repeats)


def opening(page: Path, repeats: int) -> None:
    """Seconds until all is built and drawn, in a new browser each time."""
    from playwright.sync_api import sync_playwright

    times, heap_mb = [], 0.0
    with sync_playwright() as playwright:
        for _ in range(repeats):
            browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            tab = browser.new_page()
            began = time.perf_counter()
            tab.goto(page.resolve().as_uri())
            tab.wait_for_selector("html[data-ready=true]")
            tab.wait_for_selector(".scene[data-drawn]")
            times.append(time.perf_counter() - began)
            heap_mb = max(heap_mb, tab.evaluate("performance.memory.usedJSHeapSize") / 1e6)
            browser.close()
    shown = ", ".join(f"{seconds:.1f}" for seconds in times)
    print(f"opens in {min(times):.1f} s (least of {shown}), {heap_mb:.0f} MB of JavaScript's memory")


if __name__ == "__main__":
    main()
