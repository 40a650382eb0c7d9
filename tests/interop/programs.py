"""Starts the programs under test, and ends exactly those."""
import contextlib
import json
import os
import queue
import subprocess
import threading
import time

# Bounds a test that would otherwise wait for ever; nothing is timed by it.
PATIENCE_S = 60.0


def program(name):
    """The path of a program of this project, in the folder that `run` names."""
    return os.path.join(os.environ["STOCKPILOT_PROGRAMS"], name)


class Running:
    """A program with its lines of output."""

    def __init__(self, words, stdin=None, cwd=None, env=None):
        self.words = words
        self.lines = []
        self._fresh = queue.Queue()
        self.process = subprocess.Popen(
            words, stdin=stdin, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, errors="replace", bufsize=1, cwd=cwd, env=env)
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            self._fresh.put(line.rstrip("\n"))
        self._fresh.put(None)

    def next_line(self, wanted=lambda line: True, within_s=PATIENCE_S):
        """The next line that is wanted; all lines are kept."""
        deadline = time.monotonic() + within_s
        while True:
            try:
                line = self._fresh.get(timeout=max(0.0, deadline - time.monotonic()))
            except queue.Empty:
                raise AssertionError(f"{self.words[0]} did not say it:\n{self.tail()}") from None
            if line is None:
                raise AssertionError(f"{self.words[0]} has ended:\n{self.tail()}")
            self.lines.append(line)
            if wanted(line):
                return line

    def drain(self):
        """Keeps what has been said meanwhile."""
        with contextlib.suppress(queue.Empty):
            while (line := self._fresh.get_nowait()) is not None:
                self.lines.append(line)

    def say(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()

    def tail(self):
        return "\n".join(self.lines[-40:])


@contextlib.contextmanager
def running(*words, **options):
    """A program that is ended at the end of the block."""
    child = Running(list(words), **options)
    try:
        yield child
    finally:
        child.process.terminate()
        try:
            child.process.wait(10)
        except subprocess.TimeoutExpired:
            child.process.kill()
            child.process.wait()


@contextlib.contextmanager
def stub(*options):
    """The stub autopilot; gives the addresses of its links."""
    with running(program("stockpilot-sim"), "autopilot", "--listen", "udpin:127.0.0.1:0",
                 *options) as child:
        yield json.loads(child.next_line(lambda line: line.startswith("{")))


def until(happened, within_s=PATIENCE_S, what="it"):
    """Calls `happened` until it gives something, and gives that."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if (value := happened()) is not None:
            return value
    raise AssertionError(f"{what} did not happen within {within_s} s")
