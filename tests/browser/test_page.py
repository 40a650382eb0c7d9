"""One flight from the preflight list to the decision, by the page alone. The tests go on from each other."""
import json
import os
import re
import subprocess
import sys
import urllib.error
import urllib.request

from conftest import PATIENCE_MS
from playwright.sync_api import expect

expect.set_options(timeout=PATIENCE_MS)


def picture(watched, name, **options):
    path = os.path.join(os.environ["STOCKPILOT_PICTURES"], name + ".png")
    return watched.page.screenshot(path=path, **options)


def drawn(watched, locator):
    """The pixels of an element, without waiting for a loaded machine to draw two equal frames."""
    box = locator.bounding_box()
    box["x"], box["y"] = (box[axis] + watched.page.evaluate(f"scroll{axis.upper()}") for axis in "xy")
    return watched.page.screenshot(clip=box, full_page=True)


def post(flight, path, body, **headers):
    """A request as a program sends it; gives status and answer."""
    request = urllib.request.Request(flight["page"] + path.lstrip("/"), json.dumps(body).encode(),
                                     {"Content-Type": "application/json", **headers})
    try:
        with urllib.request.urlopen(request) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()


def state(flight):
    with urllib.request.urlopen(flight["page"] + "api/state") as answer:
        return json.load(answer)


def unlock(page, token):
    page.click("#unlock")
    page.fill("#token", token)
    page.click("#token-ok")


def has_phase(page, *names):
    page.wait_for_function("(names) => names.includes(document.getElementById('phase').textContent)",
                           arg=list(names), timeout=PATIENCE_MS)


def test_without_the_token_it_is_looked_at_only(flight, desktop):
    page = desktop.page
    expect(page.locator("#liveness")).to_have_text("live")
    for verb in ["hold", "return", "land"]:
        expect(page.locator(f".buttons [data-verb={verb}]")).to_be_disabled()
    # What the buttons would send, from the page itself.
    ask = "async (verb) => (await fetch(`/api/wishes/${verb}`, {method: 'POST', headers: " \
          "{'Content-Type': 'application/json'}, body: '{}'})).status"
    for verb in ["start", "hold", "resume", "return", "land"]:
        assert page.evaluate(ask, verb) == 401, verb
    unlock(page, "not-the-token-0000")
    expect(page.locator("#token-answer")).to_contain_text("missing or wrong")
    page.click("#token-dialog [value=cancel]")
    assert state(flight)["phase"] == "idle"


def test_other_sites_and_names_are_refused_even_with_the_token(flight):
    token = {"X-Stockpilot-Token": flight["token"]}
    wish = "/api/wishes/hold"
    assert post(flight, wish, {}, **token, Origin="http://evil.example")[0] == 403
    assert post(flight, wish, {}, **token, **{"Sec-Fetch-Site": "cross-site"})[0] == 403
    assert post(flight, wish, {}, **token, Host="evil.example")[0] == 421
    # The mission itself refuses to hold on the ground: a conflict, not a refusal of the page.
    status, answer = post(flight, wish, {}, **token)
    assert status == 409 and json.loads(answer)["phase"] == "idle", answer
    # Who starts motors must say what they saw last, and that a moment ago.
    status, answer = post(flight, "/api/wishes/start", {}, **token)
    assert status == 409 and "out of date" in answer, answer
    # And who they are, and that the hall is ready.
    status, answer = post(flight, "/api/wishes/start", {"seq": state(flight)["seq"]}, **token)
    assert status == 422 and "four things" in answer, answer
    assert state(flight)["phase"] == "idle"


def test_twenty_viewers_are_served_and_one_that_takes_nothing_is_dropped(flight):
    script = os.path.join(os.path.dirname(__file__), "load.py")
    load = subprocess.run([sys.executable, script, flight["page"], "15"], capture_output=True, text=True, timeout=120)
    print(load.stdout)
    assert load.returncode == 0, load.stdout + load.stderr


def test_the_start_stands_behind_the_preflight_list(flight, desktop):
    page = desktop.page
    unlock(page, flight["token"])
    expect(page.locator("#answer")).to_contain_text("controls are open")
    page.click("#open-preflight")
    checked = [check["subject"] for check in state(flight)["preflight"]]
    assert {"position", "heading", "LiDAR", "waypoints", "battery", "mode switch", "log"} <= set(checked), checked
    expect(page.locator("#checks li")).to_have_count(len(checked))
    expect(page.locator("#checks li[data-level=bad]")).to_have_count(0)
    checks = page.locator("#checks").inner_text()
    assert "1-sigma" in checks and "%" in checks and "cm off" in checks, checks
    start = page.locator("#start")
    boxes = page.locator("#signed input[type=checkbox]")
    expect(boxes).to_have_count(4)
    for nth in range(4):
        expect(start).to_be_disabled()
        boxes.nth(nth).check()
    expect(start).to_be_disabled()
    page.fill("#declared-by", "Test Pilot")
    expect(start).to_be_enabled()
    picture(desktop, "1-preflight-desktop")
    start.click()
    expect(page.locator("#answer")).to_contain_text("START acknowledged")
    has_phase(page, "take-off", "survey")


def test_numbers_move_and_maps_are_drawn(flight, desktop, colours):
    page = desktop.page
    has_phase(page, "survey")
    figure = page.locator(".volume .figure").first
    expect(figure).to_contain_text("±")
    first = figure.inner_text()
    page.wait_for_function("(first) => document.querySelector('.volume .figure').innerText !== first",
                           arg=first, timeout=PATIENCE_MS)
    page.wait_for_function("document.querySelectorAll('#chart canvas').length > 0")
    for tab in ["height", "sigma", "coverage", "fix-quality", "change", "surface"]:
        page.click(f"[data-map={tab}]")
        canvas = page.locator("#surface canvas" if tab == "surface" else "#map")
        expect(canvas).to_be_visible()
        # The legend tells which map is drawn, in which version.
        expect(page.locator("#legend")).to_have_attribute("data-of", re.compile(rf"^{tab} \d+$"))
        expect(page.locator("#stage-note")).to_have_text("")
        picture(desktop, f"2-{tab}-desktop")
        # A blank stage has one colour; outlines, path and vehicle alone some dozens.
        n_colours = colours(drawn(desktop, canvas))
        assert n_colours > (80 if tab == "coverage" else 300), (tab, n_colours)
    # The earlier survey was of other heaps: the scale has both signs, and names what it is held against.
    page.click("[data-map=change]")
    expect(page.locator("#legend")).to_have_attribute("data-of", re.compile(r"^change \d+$"))
    expect(page.locator("#legend")).to_contain_text(re.compile(r"^since: survey of 2026-03-04-\d+\d+ cm"))
    # A section where the map is tapped.
    page.click("[data-map=height]")
    page.locator("#map").click(position={"x": 350, "y": 300})
    expect(page.locator("#section-caption")).to_contain_text("Section along x")
    assert colours(drawn(desktop, page.locator("#section-canvas"))) > 20
    page.click("#section-canvas")
    # The same numbers by the interface.
    known = state(flight)
    assert known["volumes"] and known["steps"][0] >= 0 and known["fix"]["level"] == "good", known
    assert known["target"]["percent"] == 2.0 and known["is_brain_alive"]


def test_the_phone_shows_the_same_and_the_buttons_stay_in_reach(phone, colours):
    page = phone.page
    expect(page.locator(".volume .figure").first).to_contain_text("±")
    expect(page.locator("#stage-note")).to_have_text("")
    box = page.locator(".act-hold").bounding_box()
    assert box["y"] + box["height"] <= 844 and box["height"] >= 48 and box["width"] >= 100, box
    for width in [360, 390]:
        page.set_viewport_size({"width": width, "height": 844})
        assert page.evaluate("document.documentElement.scrollWidth") <= width, "nothing to scroll sideways"
    picture(phone, "3-survey-phone")
    picture(phone, "3-survey-phone-whole", full_page=True)
    assert colours(drawn(phone, page.locator("#map"))) > 300


def test_each_button_is_acknowledged(flight, desktop, phone):
    page = desktop.page
    page.click(".act-hold")
    expect(page.locator("#answer")).to_contain_text("HOLD acknowledged: hold")
    has_phase(page, "hold")
    picture(desktop, "4-hold-desktop")
    page.click("#resume")
    expect(page.locator("#answer")).to_contain_text("RESUME acknowledged")
    has_phase(page, "survey")
    # The phone has a token of its own to type.
    expect(phone.page.locator(".act-return")).to_be_disabled()
    unlock(phone.page, flight["token"])
    phone.page.click(".act-return")
    expect(phone.page.locator("#answer")).to_contain_text("RETURN acknowledged")
    has_phase(page, "return", "land")
    page.click(".act-land")
    expect(page.locator("#answer")).to_contain_text("LAND HERE acknowledged: land")
    picture(phone, "5-land-phone")
    # Who may decide is asked on every screen.
    expect(phone.page.locator("#review-dialog")).to_be_visible()


def test_after_landing_the_gaps_are_offered_and_flown_on_the_same_map(flight, desktop, phone):
    page = desktop.page
    expect(page.locator("#review-dialog")).to_be_visible()
    expect(page.locator("#review-gap-list li").first).to_contain_text("% of the variance")
    picture(desktop, "6-review-desktop")
    assert any(gap["is_in_reach"] for gap in state(flight)["review"]["gaps"])
    token = {"X-Stockpilot-Token": flight["token"]}
    # Motors: only with a fresh picture, as for every start.
    assert post(flight, "/api/wishes/fly-gaps", {})[0] == 401
    assert post(flight, "/api/wishes/fly-gaps", {}, **token)[0] == 409
    before = state(flight)
    page.click("#fly-gaps")
    start = page.locator("#start")
    expect(start).to_have_text("START INTO GAPS")
    expect(start).to_be_disabled()
    expect(page.locator("#declared-by")).to_have_value("")
    for box in page.locator("#signed input[type=checkbox]").all():
        box.check()
    page.fill("#declared-by", "Second Pilot")
    expect(start).to_be_enabled()
    picture(desktop, "7-preflight-gaps-desktop")
    start.click()
    expect(page.locator("#answer")).to_contain_text("START INTO THE GAPS acknowledged")
    has_phase(page, "survey")
    # The map was kept, and what is added makes it surer.
    assert state(flight)["is_into_gaps"]
    page.wait_for_function(
        """async ([u, share]) => {
            const whole = (await (await fetch('/api/state')).json()).volumes[0];
            return whole.expanded_m3 < 0.95 * u && whole.shares[0] > share;
        }""",
        arg=[before["volumes"][0]["expanded_m3"], before["volumes"][0]["shares"][0]], timeout=PATIENCE_MS)
    # The dialog over the last flight is gone from every screen, before its buttons could be taken for this one's.
    expect(phone.page.locator("#review-dialog")).to_be_hidden()
    picture(desktop, "7-gaps-desktop")
    picture(phone, "7-gaps-phone")
    page.click(".act-return")
    has_phase(page, "return", "land")


def test_after_landing_somebody_decides(flight, desktop):
    page = desktop.page
    expect(page.locator("#review-dialog")).to_be_visible()
    expect(page.locator("#review-remarks")).to_contain_text("cut short")
    page.fill("#remark", "cut short for the test")
    expect(page.locator("#decided-by")).to_have_value("")
    page.fill("#decided-by", "Third Pilot")
    picture(desktop, "8-review-desktop")
    page.click("#reject")
    expect(page.locator("#answer")).to_contain_text("flight rejected")
    expect(page.locator("#open-review")).to_be_hidden()
    [path] = flight["folder"].glob("*.review.jsonl")
    kept = json.loads(path.read_text())
    assert kept["verdict"] == "rejected" and kept["remark"] == "cut short for the test", kept
    assert kept["decided_by"] == "Third Pilot", kept
    assert page.evaluate("localStorage.getItem('stockpilot.name')") == "Third Pilot"
    assert state(flight)["review"]["verdict"] == "rejected"


def test_nothing_came_from_elsewhere_and_no_address_held_the_token(flight, desktop, phone):
    for watched in [desktop, phone]:
        assert watched.complaints == []
        # Websockets are no requests here; they are allowed to the own origin only.
        assert all(url.startswith((flight["page"], "data:", "blob:")) for url in watched.urls), watched.urls
        assert not any(flight["token"] in url for url in watched.urls)
    flight["child"].drain()
    assert flight["token"] not in "\n".join(flight["child"].lines[1:]), "the token was logged"
    metrics = urllib.request.urlopen(flight["page"] + "metrics").read().decode()
    counted = {line.split()[0]: line.split()[1] for line in metrics.splitlines() if not line.startswith("#")}
    assert float(counted["stockpilot_page_viewers"]) == 2.0
    assert float(counted["stockpilot_page_requests_refused_total"]) >= 8.0
    assert float(counted["stockpilot_page_wishes_total"]) >= 6.0
