"""An arm that nobody lists: a line of JSON a reading, a line of JSON a command.

armsight doctor --driver tcp_arm:Arm --kind arm --robot ur5 --option port=7002
"""

import contextlib
import json
import socket

import numpy as np

from armsight.devices.port import ArmReading, ArmSettings
from armsight.errors import DeviceError

MODES = {"RUN": "running", "IDLE": "ready", "PSTOP": "protective_stop", "ESTOP": "emergency_stop"}


class Arm:
    def __init__(self, settings: ArmSettings) -> None:
        address = (settings.connection.get("host", "127.0.0.1"), settings.connection["port"])
        self.socket = socket.create_connection(address, timeout=1.0)
        self.lines = self.socket.makefile("r")
        self.acceleration = settings.acceleration.tolist()
        self.mode = "off"
        self.tell(watchdog=settings.watchdog)

    def tell(self, **command: object) -> None:
        self.socket.sendall(json.dumps(command).encode() + b"\n")

    def read(self) -> ArmReading:
        line = self.lines.readline()  # the next one: 250 come a second
        if not line:
            raise DeviceError("the arm has closed the connection")
        told = json.loads(line)
        self.mode = MODES.get(told["mode"], "fault")
        return ArmReading(
            stamp=1e-6 * told["us"],
            position=np.deg2rad(told["deg"]),
            velocity=np.deg2rad(told["deg_s"]),
            mode=self.mode,
            speed=told["slider"],
            message=told.get("text", ""),
        )

    def command_velocity(self, velocity: np.ndarray) -> None:
        if self.mode != "running":
            raise DeviceError(f"the arm takes no commands: {self.mode}")
        self.tell(deg_s=np.rad2deg(velocity).tolist(), acceleration=self.acceleration)

    def stop(self) -> None:
        self.tell(deg_s=[0.0] * len(self.acceleration), stop=True)

    def close(self) -> None:
        with contextlib.suppress(OSError):  # it may be closed already
            self.socket.shutdown(socket.SHUT_RDWR)  # ends a read that waits
        self.socket.close()
