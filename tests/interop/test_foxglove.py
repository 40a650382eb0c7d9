#!/usr/bin/env python3
"""A flight seen live by Foxglove's WebSocket protocol, with the `websockets` library and nothing of Foxglove's.

Every channel of the log is advertised with its schema; every message that arrives is decoded and kept to its
schema; what was said live is what stands in the log. A viewer that takes nothing costs the flight nothing.

Protocol: https://github.com/foxglove/ws-protocol, of the subprotocol `foxglove.sdk.v1`.
"""
import base64
import bisect
import collections
import json
import math
import pathlib
import socket
import struct
import sys
import tempfile
import threading
import time
import types

import jsonschema
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from programs import program, running
from websockets.sync.client import connect

SUBPROTOCOL = "foxglove.sdk.v1"
FLIGHT = ["fly", "--world", "piles", "--seed", "5", "--speed", "4", "--steps", "12", "--json", "--surface", "kalman-grid",
          "--foxglove", "127.0.0.1:0"]
# Channels that must have spoken in a flight. The others wait for faults, or for people.
SPOKEN = {"/event/tick", "/event/imu", "/event/scan", "/event/tags", "/event/vehicle", "/event/battery",
          "/result/setpoint", "/result/odometry", "/result/fix", "/result/phase", "/result/plan",
          "/result/surface", "/result/accounts", "/result/volume", "/result/ended", "/config",
          "/view/scan", "/view/pose", "/tf", "/view/log", "/view/surface"}


class Viewer:
    """A viewer of everything; keeps what it heard as (time, payload) by topic."""

    def __init__(self, address):
        self.link = connect(address, subprotocols=[SUBPROTOCOL], max_size=None, compression=None)
        assert self.link.subprotocol == SUBPROTOCOL
        self.info, self.channels, self.heard = None, {}, collections.defaultdict(list)
        self.topics = {}
        self.thread = threading.Thread(target=self._listen, daemon=True)
        self.thread.start()

    def _listen(self):
        try:
            for message in self.link:
                self._take(message)
        except Exception as error:  # the end of the flight ends the connection, tidily or not
            self.end = error

    def _take(self, message):
        if isinstance(message, str):
            said = json.loads(message)
            if said["op"] == "serverInfo":
                self.info = said
            elif said["op"] == "advertise":
                wanted = []
                for channel in said["channels"]:
                    self.channels[channel["topic"]] = channel
                    self.topics[channel["id"]] = channel["topic"]
                    wanted.append({"id": channel["id"], "channelId": channel["id"]})
                self.link.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            return
        kind, subscription, stamp = struct.unpack_from("<BIQ", message)
        if kind == 1:
            self.heard[self.topics[subscription]].append((stamp, message[13:]))


class Stalled:
    """A viewer that subscribes to everything and takes nothing more."""

    def __init__(self, address, channels):
        host, port = address.removeprefix("ws://").rsplit(":", 1)
        self.socket = socket.socket()
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        self.socket.connect((host, int(port)))
        key = base64.b64encode(bytes(16)).decode()
        self.socket.sendall(f"GET / HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\n"
                            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
                            f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n".encode())
        assert b" 101 " in self.socket.recv(64)
        text = json.dumps({"op": "subscribe", "subscriptions": [
            {"id": channel["id"], "channelId": channel["id"]} for channel in channels]}).encode()
        # One masked frame of text with zeros as its mask.
        self.socket.sendall(struct.pack(">BBH4s", 0x81, 0x80 | 126, len(text), bytes(4)) + text)


def decoders(channels):
    """By topic, what decodes a payload and complains about one that does not keep to its schema."""
    factory = DecoderFactory()
    found = {}
    for topic, channel in channels.items():
        if channel["encoding"] == "json":
            assert channel["schemaEncoding"] == "jsonschema", channel
            validator = jsonschema.Draft202012Validator(json.loads(channel["schema"]))
            found[topic] = lambda payload, v=validator: v.validate(json.loads(payload))
        else:
            assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf"), channel
            schema = types.SimpleNamespace(id=channel["id"], name=channel["schemaName"], encoding="protobuf",
                                           data=base64.b64decode(channel["schema"]))
            found[topic] = factory.decoder_for("protobuf", schema)
    return found


def in_the_log(path):
    """Channels of a log with their schemas, and its messages as (time, payload) by topic."""
    channels, messages = {}, collections.defaultdict(list)
    with open(path, "rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        for channel in summary.channels.values():
            channels[channel.topic] = (channel.message_encoding, summary.schemas[channel.schema_id])
        for _, channel, message in reader.iter_messages(log_time_order=False):
            messages[channel.topic].append((message.log_time, bytes(message.data)))
    return channels, messages


def compared(viewer, log):
    channels, messages = in_the_log(log)
    assert set(viewer.channels) == set(channels), set(viewer.channels) ^ set(channels)
    for topic, (encoding, schema) in channels.items():
        said = viewer.channels[topic]
        assert (said["encoding"], said["schemaName"]) == (encoding, schema.name), topic
        data = base64.b64decode(said["schema"]) if encoding == "protobuf" else said["schema"].encode()
        assert data == schema.data, topic
    n_heard = n_same = 0
    for topic, decode in decoders(viewer.channels).items():
        logged = set(messages[topic])
        for stamp, payload in viewer.heard[topic]:
            decode(payload)
            n_heard += 1
            n_same += (stamp, payload) in logged
    assert n_same == n_heard > 5_000, (n_same, n_heard)
    silent = {topic for topic in SPOKEN if not viewer.heard[topic]}
    assert not silent, f"nothing heard of {silent}"
    n_logged = sum(len(of_topic) for of_topic in messages.values())
    return n_heard, n_logged


def turned(q, v):
    """The vector v turned by the unit quaternion q: v + 2 w (u × v) + 2 u × (u × v)."""
    def cross(a, b):
        return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    u = [q.x, q.y, q.z]
    once = cross(u, v)
    twice = cross(u, once)
    return [v[i] + 2 * q.w * once[i] + 2 * twice[i] for i in range(3)]


def placed(viewer):
    """The LiDAR's turns, placed by `/tf` alone, lie on the last surface: median distance in height, m."""
    decode = decoders(viewer.channels)
    transforms = [decode["/tf"](payload).transforms for _, payload in viewer.heard["/tf"]]
    frames = [[(t.parent_frame_id, t.child_frame_id) for t in of_one] for of_one in transforms]
    assert all(names == [("hall", "body"), ("body", "lidar")] for names in frames), frames[0]
    grid = decode["/view/surface"](viewer.heard["/view/surface"][-1][1])
    assert grid.frame_id == "hall" and grid.fields[0].name == "elevation", grid.frame_id
    places = {nanos(of_one[0].timestamp): of_one for of_one in transforms}
    stamps = sorted(places)
    off = []
    for _, payload in viewer.heard["/view/scan"][::7]:
        scan = decode["/view/scan"](payload)
        assert scan.frame_id == "lidar", scan.frame_id
        # A turn takes 0.1 s; the pose in its middle is near enough for centimetres.
        at = nanos(scan.timestamp) + 50_000_000
        nearest = min(stamps[max(bisect.bisect(stamps, at) - 1, 0):][:2], key=lambda stamp: abs(stamp - at))
        if abs(nearest - at) < 30_000_000:
            off += heights_off(scan, places[nearest], grid)
    assert len(off) > 300, len(off)
    return sorted(off)[len(off) // 2]


def heights_off(scan, transforms, grid):
    """How far what lies steeply below the LiDAR is off the surface, m, where that is known; other beams see walls."""
    n_beams, off = len(scan.ranges), []
    step = (scan.end_angle - scan.start_angle) / (n_beams - 1)
    n_rows = len(grid.data) // grid.row_stride
    for beam in range(0, n_beams, 5):
        distance, angle = scan.ranges[beam], scan.start_angle + beam * step
        if not math.isfinite(distance):
            continue
        place = placed_by(transforms, [distance * math.cos(angle), distance * math.sin(angle), 0.0])
        if place[2] - placed_by(transforms, [0.0, 0.0, 0.0])[2] > -0.7 * distance:
            continue
        column = math.floor((place[0] - grid.pose.position.x) / grid.cell_size.x)
        row = math.floor((place[1] - grid.pose.position.y) / grid.cell_size.y)
        if 0 <= column < grid.column_count and 0 <= row < n_rows:
            [height] = struct.unpack_from("<f", grid.data, row * grid.row_stride + column * grid.cell_stride)
            if math.isfinite(height):
                off.append(abs(place[2] - height))
    return off


def placed_by(transforms, place):
    """A place in the last frame, in the first one."""
    for transform in reversed(transforms):
        place, origin = turned(transform.rotation, place), transform.translation
        place = [place[0] + origin.x, place[1] + origin.y, place[2] + origin.z]
    return place


def nanos(stamp):
    return stamp.seconds * 1_000_000_000 + stamp.nanos


def main():
    with tempfile.TemporaryDirectory() as folder, \
            running(program("stockpilot-sim"), *FLIGHT, "--log", folder) as child:
        address = json.loads(child.next_line(lambda line: line.startswith('{"foxglove"')))["foxglove"]
        viewer = Viewer(address)
        while not viewer.channels:
            assert child.process.poll() is None, child.tail()
            time.sleep(0.01)
        stalled = Stalled(address, viewer.channels.values())
        # The report of the flight is the next line of JSON.
        report = json.loads(child.next_line(lambda line: line.startswith("{"), within_s=300.0))
        child.process.wait(30)
        viewer.thread.join(10)
        assert viewer.info["name"] == "stockpilot", viewer.info
        # Nobody can publish, call or set anything.
        assert viewer.info["capabilities"] == [], viewer.info
        assert report["complete"] and report["beams_dropped"] == 0, report
        [log] = pathlib.Path(folder).glob("*.mcap")
        n_heard, n_logged = compared(viewer, log)
        off_m = placed(viewer)
        assert off_m < 0.1, off_m
        n_late = len(viewer.heard["/config"])
        assert n_late == 1, "who comes later gets the configuration too"
        stalled.socket.close()
    print(f"foxglove: {len(viewer.channels)} channels as in the log; {n_heard} of {n_logged} messages heard live, all "
          f"decoded and equal to the log's; turns placed by /tf lie {off_m:.3f} m off the surface (median); "
          "a viewer that takes nothing beside it")
    return 0


if __name__ == "__main__":
    sys.exit(main())
