"""A headless browser for tests of HTML pages: run a page, ask it questions in JavaScript, look at it.

Needs no package, only Chromium or Chrome on the machine (Debian: ``apt-get install --no-install-recommends chromium``),
or its path in ``ZBUF_OCCLUDE_BROWSER``.
"""

import html
import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
    "--disable-extensions", "--hide-scrollbars", "--mute-audio", "--force-device-scale-factor=1",
)  # fmt: skip
MISSING = "no headless browser here: install chromium (Debian: apt-get install --no-install-recommends chromium)"
_RECORDER = """<script>
window.pageErrors = [];
addEventListener("error", (event) => pageErrors.push(String(event.message)));
addEventListener("unhandledrejection", (event) => pageErrors.push(String(event.reason)));
console.error = (...words) => pageErrors.push(words.join(" "));
</script>"""
_ASKER = """<script>
addEventListener("load", () => setTimeout(async () => {
  const tell = (answer) => {
    const element = document.createElement("pre");
    element.id = "test-answer";
    element.textContent = JSON.stringify(answer);
    document.body.append(element);
  };
  const frame = () => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 20)));
  try { tell({answer: await (async () => { QUESTION })(), errors: pageErrors}); }
  catch (error) { tell({answer: null, errors: [...pageErrors, String(error)]}); }
}, 100));
</script>"""


def find_browser() -> str | None:
    """Path of the browser, or None."""
    named = os.environ.get("ZBUF_OCCLUDE_BROWSER")
    return named or next((path for name in NAMES if (path := shutil.which(name))), None)


def ask_page(page: Path, question: str, folder: Path, *, size: tuple[int, int] = (1280, 900)) -> Any:
    """Load a page and return what the JavaScript `question` returns (a function's body; may ``await frame()``).

    Raises AssertionError when the page logged an error, threw, or never answered. `folder` is for scratch.
    """
    text = page.read_text(encoding="utf-8")
    at = re.search(r"<head[^>]*>", text)
    assert at is not None, f"{page} has no <head>"
    copy = folder / f"asked-{page.name}"
    asker = _ASKER.replace("QUESTION", question)
    copy.write_text(
        text[: at.end()] + _RECORDER + text[at.end() :].replace("</body>", asker + "</body>"), encoding="utf-8"
    )
    run = _run(copy, folder, size, "--dump-dom", "--virtual-time-budget=15000", "--enable-logging=stderr", "--v=0")
    logged = [line for line in run.stderr.splitlines() if re.search(r":(ERROR|WARNING|INFO):CONSOLE", line)]
    errors = [line for line in logged if "Uncaught" in line or ":ERROR:CONSOLE" in line]
    answer = re.search(r'<pre id="test-answer">(.*?)</pre>', run.stdout, re.DOTALL)
    assert answer is not None, f"{page} gave no answer; the browser said: {run.stderr[-2000:]}"
    told = json.loads(html.unescape(answer[1]))
    assert not told["errors"] + errors, f"{page} logged errors: {told['errors'] + errors}"
    return told["answer"]


def screenshot(page: Path, png: Path, folder: Path, *, size: tuple[int, int] = (1280, 900)) -> None:
    """Save what a window of `size` shows of a page."""
    _run(page, folder, size, f"--screenshot={png}", "--virtual-time-budget=8000")


def _run(page: Path, folder: Path, size: tuple[int, int], *flags: str) -> subprocess.CompletedProcess[str]:
    browser = find_browser()
    assert browser is not None, MISSING
    profile = folder / "browser-profile"
    try:
        return subprocess.run(
            [
                browser,
                *FLAGS,
                f"--user-data-dir={profile}",
                f"--window-size={size[0]},{size[1]}",
                *flags,
                page.absolute().as_uri(),
            ],
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
    finally:
        shutil.rmtree(profile, ignore_errors=True)
