"""What the two drivers talk to where there is no hardware: a camera and an arm on a TCP port each.

python examples/drivers/device_doubles.py [CAMERA_PORT ARM_PORT]
"""

import json
import socket
import struct
import sys
import threading
import time

import numpy as np

WIDTH, HEIGHT, RATE = 160, 120, 15.0
HOME_DEG = [0.0, -90.0, 90.0, -90.0, -90.0, 0.0]


def serve(port: int, talk, *arguments) -> int:
    """Answer one client after another in a thread; returns the port."""
    door = socket.create_server(("127.0.0.1", port))

    def answer() -> None:
        while True:
            client, _ = door.accept()
            try:
                with client:
                    talk(client, *arguments)
            except OSError:
                continue  # it has gone; the next one may come

    threading.Thread(target=answer, daemon=True).start()
    return door.getsockname()[1]


def camera(client: socket.socket) -> None:
    """A plane 1.2 m away, with a stripe that gives no return."""
    lens = {"width": WIDTH, "height": HEIGHT, "fx": 140, "fy": 140, "cx": 79.5, "cy": 59.5}
    client.sendall(json.dumps(lens | {"rate": RATE, "serial": "double 0001"}).encode() + b"\n")
    depth = np.full((HEIGHT, WIDTH), 1200, "<u2")
    depth[:, :4] = 0
    count = 0
    while True:
        client.sendall(struct.pack("<IQ", count, time.monotonic_ns() // 1000) + depth.tobytes())
        count += 1
        time.sleep(1 / RATE)


def arm(client: socket.socket, state: dict) -> None:
    """Joints that follow their commanded speeds; they stop without a command for a while."""
    state |= {"deg_s": np.zeros(6), "heard": 0.0, "watchdog": 0.1}
    client.settimeout(0.0)
    waiting, last = b"", time.monotonic()
    while True:
        now = time.monotonic()
        try:
            while chunk := client.recv(65536):
                waiting += chunk
            return  # closed by the other side
        except BlockingIOError:
            pass
        *lines, waiting = waiting.split(b"\n")
        for line in lines:
            told = json.loads(line)
            state["watchdog"] = told.get("watchdog", state["watchdog"])
            if "deg_s" in told and state.get("mode", "RUN") == "RUN":
                state["commands"] = state.get("commands", 0) + ("stop" not in told)
                state["deg_s"], state["heard"] = np.array(told["deg_s"]), now
        if now - state["heard"] > state["watchdog"]:
            state["deg_s"] = np.zeros(6)
        state["deg"] = np.array(state.get("deg", HOME_DEG)) + (now - last) * state["deg_s"]
        last = now
        reading = {
            "us": time.monotonic_ns() // 1000,
            "deg": state["deg"].tolist(),
            "deg_s": state["deg_s"].tolist(),
            "mode": state.get("mode", "RUN"),
            "slider": 1.0,
        }
        client.sendall(json.dumps(reading).encode() + b"\n")
        time.sleep(0.004)


if __name__ == "__main__":
    ports = [int(word) for word in sys.argv[1:]] or [7001, 7002]
    print("camera on port", serve(ports[0], camera), "arm on port", serve(ports[1], arm, {}))
    threading.Event().wait()
