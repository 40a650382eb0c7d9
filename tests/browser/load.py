"""Twenty viewers at five states a second, and one that takes nothing: what does the page cost?

Usage: load.py PAGE [SECONDS]; PAGE is what `stockpilot-sim fly --page` or the log of `stockpilot run` names. Prints one
JSON object, and fails if the one is not dropped or the others are not served. Standard library only.
"""
import base64
import json
import os
import socket
import sys
import threading
import time
import urllib.parse
import urllib.request

VIEWERS = 20
# Of five; a busy machine may leave out a state for somebody.
LEAST_STATES_PER_SECOND = 3.0
# A viewer that gives no sign of life is dropped after 10 s at the latest, and looked for every 3 s.
LEAST_SECONDS = 15.0


def metrics(page):
    text = urllib.request.urlopen(page + "metrics").read().decode()
    return {line.split()[0]: float(line.split()[1])
            for line in text.splitlines() if not line.startswith("#") and "{" not in line}


def connect(page, receive_buffer=None):
    """An open WebSocket; what follows on it is frames."""
    host = urllib.parse.urlsplit(page).netloc
    name, port = host.rsplit(":", 1)
    link = socket.socket()
    if receive_buffer:
        link.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_buffer)
    link.connect((name, int(port)))
    key = base64.b64encode(os.urandom(16)).decode()
    link.sendall(f"GET /api/live HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                 f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        head += link.recv(1)
    assert b" 101 " in head.split(b"\r\n")[0], head
    return link


def frames(link):
    """Payloads with their kinds; a server's frames are not masked."""
    stream = link.makefile("rb")
    while (head := stream.read(2)) and len(head) == 2:
        size = head[1] & 0x7F
        if size == 126:
            size = int.from_bytes(stream.read(2), "big")
        elif size == 127:
            size = int.from_bytes(stream.read(8), "big")
        yield head[0] & 0x0F, stream.read(size)


def view(page, heard, stop):
    link = connect(page)
    for kind, payload in frames(link):
        if kind == 9:
            # A pong, masked with zeros.
            link.sendall(bytes([0x8A, 0x80, 0, 0, 0, 0]))
        elif kind == 1:
            heard.append(len(payload))
        if stop.is_set():
            link.close()
            return


def main():
    page = sys.argv[1]
    seconds = max(LEAST_SECONDS, float(sys.argv[2]) if len(sys.argv) > 2 else 30.0)
    stop, heard = threading.Event(), [[] for _ in range(VIEWERS)]
    idle = metrics(page)
    time.sleep(5.0)
    before_viewers = metrics(page)
    threads = [threading.Thread(target=view, args=(page, of_one, stop), daemon=True) for of_one in heard]
    for thread in threads:
        thread.start()
    stalled = connect(page, receive_buffer=4096)
    began, before = time.monotonic(), metrics(page)
    time.sleep(seconds)
    elapsed, after = time.monotonic() - began, metrics(page)
    stop.set()
    slowest = min(map(len, heard)) / elapsed
    cpu = "stockpilot_page_cpu_seconds_total"
    seen = {
        "viewers": VIEWERS,
        "seconds": round(elapsed, 1),
        "states_per_viewer_and_second": round(sum(map(len, heard)) / VIEWERS / elapsed, 2),
        "states_of_the_slowest_per_second": round(slowest, 2),
        "bytes_per_state": round(sum(map(sum, heard)) / max(1, sum(map(len, heard)))),
        "core_share_percent": round(100 * (after[cpu] - before[cpu]) / elapsed, 2),
        "core_share_percent_without_viewers": round(100 * (before_viewers[cpu] - idle[cpu]) / 5.0, 2),
        "dropped": after["stockpilot_page_viewers_dropped_total"] - before["stockpilot_page_viewers_dropped_total"],
        "ticks_skipped": after["stockpilot_brain_ticks_skipped_total"] - before["stockpilot_brain_ticks_skipped_total"],
        "news_lost": after["stockpilot_page_news_lost_total"] - before["stockpilot_page_news_lost_total"],
    }
    print(json.dumps(seen))
    stalled.close()
    assert seen["dropped"] == 1.0, "the viewer that takes nothing, and nobody else, is dropped"
    assert slowest >= LEAST_STATES_PER_SECOND, "everybody else is served"
    assert seen["news_lost"] == 0.0, "the brain's news reach the page all the same"


if __name__ == "__main__":
    main()
