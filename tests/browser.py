"""A headless browser for tests of pages: load a file or an address, ask it in JavaScript, use the mouse, look at it.

Needs no package, only Chromium or Chrome on the machine (Debian: ``apt-get install --no-install-recommends chromium``),
or its path in ``ZBUF_OCCLUDE_BROWSER``. Speaks the Chrome DevTools protocol over a pipe.

    with open_page(path, tmp_path) as page:
        assert page.ask("return document.title") == "..."
        page.drag((200, 200), (300, 220))
        page.screenshot(tmp_path / "page.png")
    # leaving raises AssertionError when the page logged an error
"""

import base64
import json
import os
import select
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync",
    "--disable-background-networking", "--disable-component-update", "--disable-dev-shm-usage",
    "--disable-extensions", "--hide-scrollbars", "--mute-audio", "--force-device-scale-factor=1",
    "--remote-debugging-pipe",
)  # fmt: skip
PATIENCE = 60.0
"""Seconds after which the browser is taken for hung."""


def find_browser() -> str | None:
    """Path of the browser, or None."""
    named = os.environ.get("ZBUF_OCCLUDE_BROWSER")
    return named or next((path for name in NAMES if (path := shutil.which(name))), None)


class Page:
    """A loaded page. `open_page` makes it."""

    def __init__(self, to_browser: int, from_browser: int) -> None:
        self._to, self._from = to_browser, from_browser
        self._buffer = b""
        self._number = 0
        self._session: str | None = None
        self._target: str | None = None
        self._loaded = False
        self.errors: list[str] = []

    def ask(self, question: str) -> Any:
        """Return what a function of this JavaScript body returns; it may await, ``await frame()`` for one drawn."""
        wrapped = (
            "(async () => { const frame = () => new Promise((done) => "
            f"requestAnimationFrame(() => setTimeout(done, 20)));\n{question}\n}})()"
        )
        answer = self._call("Runtime.evaluate", expression=wrapped, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in answer:
            details = answer["exceptionDetails"]
            raise AssertionError(details.get("exception", {}).get("description", details["text"]))
        return answer["result"].get("value")

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the mouse at a place (pixels from the window's upper left), move, let go."""
        self._mouse("mousePressed", start, button="left", clickCount=1)
        for t in (0.5, 1.0):
            place = (start[0] + t * (end[0] - start[0]), start[1] + t * (end[1] - start[1]))
            self._mouse("mouseMoved", place, button="left")
        self._mouse("mouseReleased", end, button="left", clickCount=1)
        self.ask("await frame()")

    def wheel(self, place: tuple[float, float], delta: float) -> None:
        """Turn the wheel; a negative delta is away from the user."""
        self._mouse("mouseWheel", place, deltaX=0, deltaY=delta)
        self.ask("await frame(); await frame()")

    def screenshot(self, png: Path) -> None:
        """Save what the window shows."""
        png.write_bytes(base64.b64decode(self._call("Page.captureScreenshot", format="png")["data"]))

    def load(self, path: Path | str, size: tuple[int, int]) -> None:
        """Open a tab of this size with a file or an address, in place of the one before; wait until it is loaded."""
        self._session, before = None, self._target
        self._target = self._call("Target.createTarget", url="about:blank")["targetId"]
        if before:
            self._call("Target.closeTarget", targetId=before)
        self._session = self._call("Target.attachToTarget", targetId=self._target, flatten=True)["sessionId"]
        self._call(
            "Emulation.setDeviceMetricsOverride", width=size[0], height=size[1], deviceScaleFactor=1, mobile=False
        )
        for domain in ("Runtime", "Log", "Page"):
            self._call(f"{domain}.enable")
        self._loaded = False
        self._call("Page.navigate", url=path if isinstance(path, str) else path.absolute().as_uri())
        while not self._loaded:
            self._note(self._receive())
        self.ask("await frame(); await frame()")

    def quit(self) -> None:
        """Ask the browser to end."""
        self._session = None
        self._call("Browser.close")

    def _mouse(self, kind: str, place: tuple[float, float], **more: Any) -> None:
        self._call("Input.dispatchMouseEvent", type=kind, x=place[0], y=place[1], **more)

    def _call(self, method: str, **parameters: Any) -> Any:
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]
            self._note(answer)

    def _receive(self) -> dict[str, Any]:
        end = time.monotonic() + PATIENCE
        while b"\0" not in self._buffer:
            readable, _, _ = select.select([self._from], [], [], max(0.0, end - time.monotonic()))
            assert readable, f"the browser said nothing for {PATIENCE:g} s"
            piece = os.read(self._from, 1 << 20)
            assert piece, "the browser ended"
            self._buffer += piece
        text, self._buffer = self._buffer.split(b"\0", 1)
        message: dict[str, Any] = json.loads(text)
        return message

    def _note(self, event: dict[str, Any]) -> None:
        method, parameters = event.get("method"), event.get("params", {})
        if method == "Page.loadEventFired":
            self._loaded = True
        elif method == "Runtime.exceptionThrown":
            details = parameters["exceptionDetails"]
            self.errors.append(details.get("exception", {}).get("description", details["text"]))
        elif method == "Runtime.consoleAPICalled" and parameters["type"] in ("error", "assert"):
            self.errors.append(" ".join(str(a.get("value", a.get("description"))) for a in parameters["args"]))
        elif method == "Log.entryAdded" and parameters["entry"]["level"] == "error":
            self.errors.append(parameters["entry"]["text"])


@contextmanager
def open_page(path: Path | str, folder: Path, *, size: tuple[int, int] = (1280, 900)) -> Iterator[Page]:
    """Load a file or an address in a new browser; `folder` is for scratch. Fails when the page logged an error."""
    browser = find_browser()
    assert browser is not None, "no headless browser here"
    theirs_in, ours_out = os.pipe()
    ours_in, theirs_out = os.pipe()

    def to_3_and_4() -> None:  # where the browser looks for its pipe
        low, high = os.dup(theirs_in), os.dup(theirs_out)
        os.dup2(low, 3)
        os.dup2(high, 4)

    profile = folder / "browser-profile"
    process = subprocess.Popen(
        [browser, *FLAGS, f"--user-data-dir={profile}", "about:blank"],
        preexec_fn=to_3_and_4,  # the only way to choose the numbers
        pass_fds=(3, 4),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(theirs_in)
    os.close(theirs_out)
    page = Page(ours_out, ours_in)
    try:
        page.load(path, size)
        yield page
        assert not page.errors, f"{path} logged errors: {page.errors}"
        page.quit()
        process.wait(10)
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
        os.close(ours_in)
        os.close(ours_out)
        shutil.rmtree(profile, ignore_errors=True)
