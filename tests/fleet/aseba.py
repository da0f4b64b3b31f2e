"""A stand-in for a Thymio on TCP: Aseba's messages, and a robot that drives ahead of a wall. `python aseba.py PORT`."""

from __future__ import annotations

import socket
import struct
import sys
import time

NODE = 7
VARIABLES = {
    "_id": 1, "prox.horizontal": 7, "prox.ground.delta": 2, "motor.left.target": 1, "motor.right.target": 1,
    "motor.left.speed": 1, "motor.right.speed": 1,
}  # fmt: skip
LIST, DESCRIBE, GET, SET = 0xA011, 0xA010, 0xA00B, 0xA00C
PRESENT, DESCRIPTION, VARIABLE, FUNCTION, VALUES = 0x900C, 0x9000, 0x9001, 0x9003, 0x9005


def words(*numbers: int) -> bytes:
    return struct.pack(f"<{len(numbers)}H", *(number & 0xFFFF for number in numbers))


def text(name: str) -> bytes:
    return bytes([len(name)]) + name.encode()


class Robot:
    """Its variables, and how far it is from the wall in front."""

    def __init__(self, wall: float = 0.10) -> None:
        self.wall, self.at = wall, time.monotonic()
        self.memory = [0] * sum(VARIABLES.values())

    def place(self, name: str) -> int:
        return sum(size for one, size in list(VARIABLES.items())[: list(VARIABLES).index(name)])

    def go(self) -> None:
        now = time.monotonic()
        left, right = (self.memory[self.place(f"motor.{side}.target")] for side in ("left", "right"))
        for side, speed in (("left", left), ("right", right)):
            self.memory[self.place(f"motor.{side}.speed")] = speed
        self.wall -= 0.0004 * 0.5 * (left + right) * (now - self.at)
        self.at = now
        near = max(0, min(4500, round(4500 * (1.0 - self.wall / 0.12))))
        self.memory[self.place("prox.horizontal") :][:7] = [0] * 7
        self.memory[self.place("prox.horizontal") + 2] = near

    def answers(self, kind: int, payload: bytes) -> list[tuple[int, bytes]]:
        self.go()
        given = struct.unpack(f"<{len(payload) // 2}H", payload)
        if kind == LIST:
            return [(PRESENT, words(5))]
        if kind == DESCRIBE:
            head = text("thymio-II") + words(5, 1534, 32, 620, len(VARIABLES), 0, 1)
            named = [(VARIABLE, words(size) + text(name)) for name, size in VARIABLES.items()]
            return [(DESCRIPTION, head), *named, (FUNCTION, text("math.copy") + text("") + words(0))]
        if kind == GET:
            _, offset, count = given
            return [(VALUES, words(offset, *self.memory[offset : offset + count]))]
        if kind == SET:
            signed = [one - 65_536 if one > 32_767 else one for one in given[2:]]
            self.memory[given[1] : given[1] + len(signed)] = signed
        return []


def serve(port: int) -> None:
    """One connection after the other; prints the motors' targets whenever they change."""
    robot, shown = Robot(), None
    with socket.create_server(("127.0.0.1", port)) as server:
        print("there", flush=True)
        while True:
            connection, _ = server.accept()
            with connection, connection.makefile("rb") as stream:
                while head := stream.read(6):
                    length, _, kind = struct.unpack("<3H", head)
                    for answer, payload in robot.answers(kind, stream.read(length)):
                        whole = words(len(payload), NODE, answer) + payload
                        for at in range(0, len(whole), 5):  # as a slow line would
                            connection.sendall(whole[at : at + 5])
                    targets = [robot.memory[robot.place(f"motor.{side}.target")] for side in ("left", "right")]
                    if kind == SET and targets != shown:
                        shown = targets
                        print(*targets, flush=True)


if __name__ == "__main__":
    serve(int(sys.argv[1]))
