#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The page in a real browser: it shows what the box does, captures with the token, tells what is refused, and hands out what is kept. `--screenshots FOLDER` keeps what it looks like."""

import pathlib
import re
import sys

import box
import browser
from http_talk import get, status_of

CAMERAS = 3


def look(page, name: str) -> None:
    if "--screenshots" in sys.argv:
        page.screenshot(pathlib.Path(sys.argv[sys.argv.index("--screenshots") + 1]) / f"{name}.png")


def the_box_is_shown(page, the_box) -> None:
    box.until(lambda: page.text("#state") == "○ idle", "the state is shown")
    box.until(lambda: page.text("#unit") == get(the_box.http_port, "/api/v1/system").json()["unit"], "the box's name is shown")
    assert page.text("#advice") == status_of(the_box)["advice"] and page.text("#throws") == "0"
    assert page.text("#software").startswith("throwcal ") and page.value("document.title").startswith("throwcal ")
    assert page.is_shown("#no-calibration")
    for hidden in ("#problems-section", "#sessions-section", "#calibration"):
        assert not page.is_shown(hidden), hidden
    sizes = "[...document.querySelectorAll('#cameras img')].map((image) => [image.naturalWidth, image.naturalHeight])"
    box.until(lambda: page.value(sizes) == [[320, 240]] * CAMERAS, "a picture of each camera is shown")
    box.until(lambda: page.text("figcaption").startswith("✔ cam1: "), "and what is told of it")
    page.value("window.states = []; new MutationObserver(() => states.push(byId('state').textContent)).observe(byId('state'), {childList: true})")


def pictures_go_on(page) -> None:
    shown = lambda: page.value("[...document.querySelectorAll('#cameras img')].map((image) => image.src)")
    before = shown()
    box.until(lambda: not set(before) & set(shown()), "newer pictures")
    page.click("#show-pictures")
    assert page.value("byId('show-pictures').checked") is False
    page.click("#show-pictures")


def who_may_not_is_told_so_in_words(page, the_box) -> None:
    for token, said in [
        ("", "show the box's token first"),
        ("not-the-token", "this is not the box's token"),
        ("ключ", "this is not the box's token"),
    ]:
        page.type_into("#token", token)
        page.click("button[value=start]")
        box.until(lambda: page.text("#answer").startswith("✖ ") and said in page.text("#answer"), f"{token!r} is refused in words")
        assert page.value("document.activeElement.id") == "token", "where to mend it"
        page.value("say('answer', '')")
    assert status_of(the_box)["session"] is None
    refused = [fault for fault in page.faults if re.fullmatch(r"401: .*/api/v1/capture/start", fault)]
    assert len(refused) == 2 and refused == page.faults, page.faults
    page.faults.clear()


def a_session_is_captured(page, the_box) -> None:
    page.type_into("#token", the_box.token)
    page.click("button[value=start]")
    box.until(lambda: page.text("#answer") == "✔ Capture", "it is begun")
    box.until(lambda: "● capturing: throw the ball" in page.value("states"), "the page says that it captures")
    look(page, "capturing")
    box.until(lambda: int(page.text("#throws")) >= 1, "throws are counted")
    box.until(lambda: page.text("#state") == "✔ done", "it ends itself")
    status = status_of(the_box)
    assert status["state"] == "done" and page.text("#verdict") == status["verdict"] == "accepted", (page.text("#verdict"), status)
    assert int(page.text("#throws")) == status["throws"] and page.text("#position").startswith("✔ ") and page.text("#rotation").startswith("✔ ")
    print("states shown:", *dict.fromkeys(page.value("states")), sep="\n  ")


def what_is_kept_can_be_fetched(page, the_box) -> None:
    box.until(lambda: page.is_shown("#calibration") and page.is_shown("#sessions a"), "links to what is kept")
    assert page.downloaded("#calibration") == ("calibration.json", get(the_box.http_port, "/api/v1/calibration/latest").body)
    file = the_box.folder / "state" / "sessions" / "000001.throwcal"
    assert page.downloaded("#sessions a") == (file.name, file.read_bytes())
    assert re.search(r"000001\.throwcal .*, done, \d+ throws?, accepted, \d+\.\d MB", page.text("#sessions")), page.text("#sessions")


def a_session_is_thrown_away(page, the_box) -> None:
    page.click("button[value=start]")
    box.until(lambda: page.text("#answer") == "✔ Capture" and page.value("document.querySelectorAll('#sessions li').length") == 2, "a second one")
    assert page.value("document.querySelectorAll('#sessions a').length") == 1, "the one under way can't be fetched"
    page.click("button[value=abort]")
    box.until(lambda: page.text("#answer") == "✔ Abort" and page.text("#state") == "○ idle", "it is thrown away")
    box.until(lambda: page.value("document.querySelectorAll('#sessions a').length") == 2, "its file is there")
    page.click("button[value=stop]")
    box.until(lambda: "nothing is being captured" in page.text("#answer"), "a refusal in words")
    assert [fault.split("/")[-1] for fault in page.faults] == ["stop"] and page.faults[0].startswith("409: "), page.faults
    page.faults.clear()


def it_fits(page) -> None:
    for width_px in (320, 360, 800, 1400):
        page.resize(width_px, 800)
        assert page.value("document.documentElement.scrollWidth") <= width_px, f"wider than {width_px} px"
        look(page, f"done-{width_px}")


def a_box_that_is_gone_is_told(page, the_box) -> None:
    the_box.stop()
    box.until(lambda: page.text("#state") == "✖ no connection to the box", "the page says that the box is gone")
    page.click("button[value=start]")
    box.until(lambda: page.text("#answer").startswith("✖ the box does not answer: "), "and so does a button")


def story(build, folder) -> None:
    box.simulate(build, folder, "--cameras", str(CAMERAS), "--width", "320", "--height", "240", "--focal", "240", "--fps", "30")
    with box.running_box(build, folder) as the_box:
        box.until(lambda: all(c["frames"] > 0 for c in status_of(the_box)["cameras"]), "every camera runs")
        with browser.Page(folder, f"http://127.0.0.1:{the_box.http_port}/", 1000, 800) as page:
            the_box_is_shown(page, the_box)
            pictures_go_on(page)
            who_may_not_is_told_so_in_words(page, the_box)
            a_session_is_captured(page, the_box)
            what_is_kept_can_be_fetched(page, the_box)
            assert not page.faults, page.faults
            a_session_is_thrown_away(page, the_box)
            it_fits(page)
            assert not page.faults, page.faults
            a_box_that_is_gone_is_told(page, the_box)


if __name__ == "__main__":
    if not browser.PROGRAM:
        print("skipped: needs a browser (apt install chromium: 108 MB, 360 MB on the disk)")
        sys.exit(77)
    box.main(story)
