# SPDX-License-Identifier: BSD-3-Clause
"""A page in Chromium, by its DevTools protocol over a pipe: what a person sees, types and clicks there, and what goes wrong meanwhile."""

import base64
import fcntl
import json
import os
import pathlib
import select
import shutil
import signal
import subprocess
import time

import box

PROGRAM = shutil.which("chromium") or shutil.which("google-chrome")


class Page:
    """One page, open at `address` in a browser of its own. `faults`: errors of the console, requests that failed."""

    def __init__(self, folder: pathlib.Path, address: str, width_px: int, height_px: int):
        self.folder, self.faults, self.downloads = folder, [], {}
        self.last_id, self.unread = 0, b""
        orders, self.orders = (self.high(fd) for fd in os.pipe())
        self.messages, messages = (self.high(fd) for fd in os.pipe())
        options = ["--headless=new", "--no-sandbox", "--remote-debugging-pipe", f"--user-data-dir={folder / 'browser'}", "--disable-gpu",
                   "--disable-dev-shm-usage", "--no-first-run", "--disable-background-networking", "--disable-component-update", "about:blank"]  # fmt: skip
        self.log = open(folder / "browser.log", "wb")
        self.process = subprocess.Popen(["bash", "-c", f'exec "$@" 3<&{orders} 4>&{messages}', "bash", PROGRAM, *options], pass_fds=(orders, messages),
                                        stdin=subprocess.DEVNULL, stdout=self.log, stderr=self.log, start_new_session=True)  # fmt: skip
        os.close(orders)
        os.close(messages)
        self.session = None
        target = self.order("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.order("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.order(domain + ".enable")
        self.order("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder), eventsEnabled=True)
        self.resize(width_px, height_px)
        self.order("Page.navigate", url=address)
        box.until(lambda: self.value("document.readyState") == "complete", "the page is loaded")

    @staticmethod
    def high(fd: int) -> int:
        """The same end of a pipe, out of the way of the numbers 3 and 4."""
        moved = fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, 10)
        os.close(fd)
        return moved

    def __enter__(self):
        return self

    def __exit__(self, *_):
        os.killpg(self.process.pid, signal.SIGKILL)  # its own group
        self.process.wait()
        os.close(self.orders)
        os.close(self.messages)
        self.log.close()

    def message(self) -> dict:
        deadline = time.monotonic() + box.PATIENCE_S
        while b"\0" not in self.unread:
            ready, _, _ = select.select([self.messages], [], [], max(0, deadline - time.monotonic()))
            piece = os.read(self.messages, 1 << 20) if ready else b""
            assert piece, f"the browser says nothing more:\n{(self.folder / 'browser.log').read_text()}"
            self.unread += piece
        text, _, self.unread = self.unread.partition(b"\0")
        return json.loads(text)

    def order(self, method: str, **params) -> dict:
        self.last_id += 1
        order = {"id": self.last_id, "method": method, "params": params} | ({"sessionId": self.session} if self.session else {})
        text = json.dumps(order).encode() + b"\0"
        while text:
            text = text[os.write(self.orders, text) :]
        while (message := self.message()).get("id") != self.last_id:
            self.note(message.get("method"), message.get("params", {}))
        assert "result" in message, (method, message)
        return message["result"]

    def note(self, event: str, facts: dict) -> None:
        if event == "Runtime.exceptionThrown":
            self.faults.append(f"exception: {facts['exceptionDetails']}")
        elif event == "Runtime.consoleAPICalled" and facts["type"] in ("error", "warning", "assert"):
            self.faults.append(f"console: {facts['args']}")
        elif event == "Log.entryAdded" and facts["entry"]["level"] in ("error", "warning") and facts["entry"]["source"] != "network":
            self.faults.append(f"log: {facts['entry']['text']}")
        elif event == "Network.responseReceived" and facts["response"]["status"] >= 400:
            self.faults.append(f"{facts['response']['status']}: {facts['response']['url']}")
        elif event == "Network.loadingFailed" and not facts.get("canceled"):
            self.faults.append(f"no answer: {facts['errorText']}")
        elif event == "Browser.downloadWillBegin":
            self.downloads[facts["guid"]] = [facts["suggestedFilename"], "inProgress"]
        elif event == "Browser.downloadProgress":
            self.downloads[facts["guid"]][1] = facts["state"]

    def value(self, expression: str):
        """Of JavaScript, in the page."""
        answer = self.order("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, (expression, answer)
        return answer["result"].get("value")

    def text(self, selector: str) -> str:
        """What is to be read there; nothing where it is hidden."""
        return self.value(f"document.querySelector({json.dumps(selector)}).innerText").strip()

    def is_shown(self, selector: str) -> bool:
        return self.value(f"Boolean(document.querySelector({json.dumps(selector)})?.checkVisibility())")

    def click(self, selector: str) -> None:
        """With the mouse, in its middle; somebody else's element there is a fault."""
        place = self.value(f"""(() => {{
            const it = document.querySelector({json.dumps(selector)});
            it.scrollIntoView({{block: "center", behavior: "instant"}});
            const box = it.getBoundingClientRect(), at = {{x: box.x + box.width / 2, y: box.y + box.height / 2}};
            const hit = document.elementFromPoint(at.x, at.y);
            return {{...at, is_reached: it === hit || it.contains(hit)}};
        }})()""")
        assert place.pop("is_reached"), f"{selector} can't be clicked"
        for event in ("mousePressed", "mouseReleased"):
            self.order("Input.dispatchMouseEvent", type=event, button="left", clickCount=1, **place)

    def type_into(self, selector: str, text: str) -> None:
        """In place of what stands there."""
        self.click(selector)
        self.value(f"document.querySelector({json.dumps(selector)}).select()")
        self.order("Input.insertText", text=text)

    def downloaded(self, selector: str) -> tuple[str, bytes]:
        """The name and content of what a click there fetches."""
        before = set(self.downloads)
        self.click(selector)

        def ended():
            self.value("0")  # hears what the browser has to say
            return [d for guid, d in self.downloads.items() if guid not in before and d[1] != "inProgress"]

        (name, state), *more = box.until(ended, f"{selector} is downloaded")
        assert state == "completed" and not more, (selector, self.downloads)
        return name, (self.folder / name).read_bytes()

    def resize(self, width_px: int, height_px: int) -> None:
        self.order("Emulation.setDeviceMetricsOverride", width=width_px, height=height_px, deviceScaleFactor=1, mobile=width_px < 600)

    def screenshot(self, file: pathlib.Path) -> None:
        file.write_bytes(base64.b64decode(self.order("Page.captureScreenshot", captureBeyondViewport=True)["data"]))
