"""A simulated flight that waits for its page, and a browser."""
import json
import os
import shutil
import sys

import pytest
from playwright.sync_api import sync_playwright

sys.path.insert(0, os.path.join(os.path.dirname(__file__), "..", "interop"))
from programs import program, running  # noqa: E402

# Bounds a test that would otherwise wait for ever; nothing is timed by it.
PATIENCE_MS = 90_000
# Root has no sandbox; without a graphics card WebGL is drawn in software.
CHROMIUM = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist",
            "--disable-accelerated-2d-canvas"]


@pytest.fixture(scope="session")
def flight(tmp_path_factory):
    """Address and token of the page of a flight, and its folder."""
    folder = tmp_path_factory.mktemp("flight")
    words = [program("stockpilot-sim"), "fly", "--page", "127.0.0.1:0", "--wait", "--speed", "1",
             "--seed", "5", "--world", "piles", "--log", str(folder),
             "--last-survey", os.environ["STOCKPILOT_EARLIER"],
             # Slow enough for a loaded machine to look at every map before the survey is over.
             "--cruise-mps", "0.4"]
    with running(*words) as child:
        line = child.next_line(lambda line: line.startswith("{"))
        found = json.loads(line)
        found["folder"] = folder
        found["child"] = child
        yield found


@pytest.fixture(scope="session")
def browser():
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=CHROMIUM)
        yield chromium
        chromium.close()


class Watched:
    """A page whose requests and complaints are kept."""

    def __init__(self, context, url):
        self.urls, self.complaints = [], []
        self.page = context.new_page()
        self.page.on("request", lambda request: self.urls.append(request.url))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("console", self._heard)
        self.page.goto(url)

    def _heard(self, message):
        # A refused wish is an answer with an error's status, which the browser notes by itself.
        is_refusal = "the server responded with a status of 4" in message.text
        if message.type == "error" and not is_refusal:
            self.complaints.append(message.text)


@pytest.fixture(scope="session")
def desktop(browser, flight):
    context = browser.new_context(viewport={"width": 1600, "height": 1000})
    context.set_default_timeout(PATIENCE_MS)
    yield Watched(context, flight["page"])
    context.close()


@pytest.fixture(scope="session")
def phone(browser, flight):
    context = browser.new_context(viewport={"width": 390, "height": 844}, device_scale_factor=2,
                                  is_mobile=True, has_touch=True)
    context.set_default_timeout(PATIENCE_MS)
    yield Watched(context, flight["page"])
    context.close()


@pytest.fixture(scope="session")
def colours(browser):
    """Counts the different colours of a picture (PNG)."""
    page = browser.new_page()
    count = """async (png) => {
        const picture = await createImageBitmap(await (await fetch(png)).blob());
        const canvas = new OffscreenCanvas(picture.width, picture.height);
        const to = canvas.getContext('2d');
        to.drawImage(picture, 0, 0);
        const data = new Uint32Array(to.getImageData(0, 0, picture.width, picture.height).data.buffer);
        return new Set(data).size;
    }"""

    def of(png):
        import base64
        return page.evaluate(count, "data:image/png;base64," + base64.b64encode(png).decode())

    yield of
    page.close()
