"""Chromium without a screen, told what to do over its remote-debugging protocol."""

import base64
import json
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.request import urlopen

CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None
)


class Tab:
    """One tab; errors: what its console has complained of."""

    def __init__(self, socket: Any) -> None:
        self._socket, self._number = socket, 0
        self.errors: list[str] = []
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """What the browser answers."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv())
            if message.get("id") == self._number:
                assert "error" not in message, message
                found: dict[str, Any] = message["result"]
                return found
            self._note(message)

    def run(self, code: str) -> Any:
        """The value of an expression of JavaScript; a promise's once it is there."""
        done = self.call("Runtime.evaluate", expression=code, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in done, done
        return done["result"].get("value")

    def wait(self, code: str, limit_s: float = 240) -> Any:
        """The value of an expression as soon as it is true."""
        end_s = time.monotonic() + limit_s
        while not (value := self.run(code)):
            assert time.monotonic() < end_s, f"never came true: {code}"
            time.sleep(0.3)
        return value

    def press(self, key: str) -> None:
        """A key, as a hand would press it."""
        code = {"ArrowRight": 39, "ArrowDown": 40}[key]
        for kind in ("rawKeyDown", "keyUp"):
            self.call(
                "Input.dispatchKeyEvent", type=kind, key=key, code=key, windowsVirtualKeyCode=code
            )

    def picture(self, file: Path) -> None:
        """A screenshot."""
        file.write_bytes(base64.b64decode(self.call("Page.captureScreenshot")["data"]))

    def _note(self, message: dict[str, Any]) -> None:
        told = message.get("params", {})
        if message.get("method") == "Runtime.exceptionThrown":
            self.errors.append(json.dumps(told["exceptionDetails"])[:500])
        elif message.get("method") == "Runtime.consoleAPICalled" and told["type"] == "error":
            self.errors.append(" ".join(str(a.get("value", a)) for a in told["args"])[:500])


@contextmanager
def opened(address: str, folder: Path, size: tuple[int, int] = (1280, 1400)) -> Iterator[Tab]:
    """A tab that shows an address; what the browser writes goes into ``folder``."""
    import websocket

    command = [
        str(CHROMIUM), "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
        "--disable-dev-shm-usage", "--remote-debugging-port=0", "--remote-allow-origins=*",
        f"--window-size={size[0]},{size[1]}", f"--user-data-dir={folder}", "about:blank",
    ]  # fmt: skip
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, stdout=quiet, stderr=quiet) as browser:
        try:
            port_file = folder / "DevToolsActivePort"
            until(lambda: port_file.exists() and port_file.read_text().strip())
            port = port_file.read_text().split()[0]
            pages = json.load(urlopen(f"http://127.0.0.1:{port}/json"))
            target = next(page for page in pages if page["type"] == "page")
            socket = websocket.create_connection(target["webSocketDebuggerUrl"], timeout=300)
            tab = Tab(socket)
            tab.call("Page.navigate", url=address)
            yield tab
            socket.close()
        finally:
            browser.terminate()


def until(true: Callable[[], Any], limit_s: float = 120) -> None:
    """Wait for something to be so."""
    end_s = time.monotonic() + limit_s
    while not true():
        assert time.monotonic() < end_s, "it did not happen in time"
        time.sleep(0.1)
